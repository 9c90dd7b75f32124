"""Whether anybody listens where central should be. A stopped process does, one that has ended does not."""

import errno
import socket

_WITHIN = 0.2  # seconds that a connection may take


def is_anybody_there(address: str) -> bool:
    """Whether the operating system takes connections to *address* (``ipc://`` or ``tcp://``), as it does for a stopped
    process too.
    """
    try:
        if address.startswith("ipc://"):
            path = address.removeprefix("ipc://")
            with socket.socket(socket.AF_UNIX) as probe:
                probe.settimeout(_WITHIN)
                probe.connect(f"\0{path[1:]}" if path.startswith("@") else path)
            return True
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        socket.create_connection((host.strip("[]"), int(port)), _WITHIN).close()
    except OSError as error:
        return error.errno == errno.EAGAIN  # of a Unix socket: more have come than a process that stands still took
    except ValueError:
        return False
    return True
