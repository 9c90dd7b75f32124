"""The lock of a Unix socket's address, which only one central may use."""

import os
from pathlib import Path

from tca_central.errors import CentralError
from tca_central.shell.log_writer import lock
from tca_wire.endpoint import default_folder


def lock_address(endpoint: str) -> int:
    """Lock a Unix socket's address against other centrals. Return the lock's file (-1: TCP).

    ZeroMQ would silently take over the address of a running central.
    """
    if not endpoint.startswith("ipc:///"):
        return -1
    path = Path(endpoint.removeprefix("ipc://"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        owner = path.parent.stat().st_uid
        if path.parent == default_folder() and owner == os.getuid():
            path.parent.chmod(0o700)  # a user may have made it with other permissions
        locked = os.open(
            f"{path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600
        )
        lock(locked)
    except BlockingIOError:
        msg = (
            f"can't listen on {endpoint}: another central uses it; stop it, "
            "or choose another address with --bind"
        )
        raise CentralError(msg) from None
    except OSError as error:
        msg = f"can't listen on {endpoint}: {error.strerror}; choose another address with --bind"
        raise CentralError(msg) from None
    if owner not in (os.getuid(), 0):
        msg = f"{path.parent} belongs to another user: choose another address with --bind"
        raise CentralError(msg)
    return locked
