"""Where central listens: probes of addresses, and the search in a list of them."""

import errno
import functools
import os
import socket as sockets
import threading
from collections.abc import Sequence

_PROBED_WITHIN = 0.2  # seconds
_FOUND_AT_ONCE = 0.02  # seconds that ``seek`` waits: programs of this computer answer in one


def accepts_connections(address: str) -> bool:
    """Return whether the operating system accepts connections to *address*.

    The system accepts them for a stopped process, but not for a process that has ended. *address*
    is ``ipc://`` or ``tcp://``.
    """
    try:
        _probe(address).close()
    except OSError as error:
        # EAGAIN: the queue of the Unix socket is full, because its process is stopped.
        return error.errno == errno.EAGAIN
    except ValueError:
        return False
    return True


def rejects_connections(address: str) -> bool:
    """Return whether connections to *address* are cut at once, as by an overloaded central."""
    try:
        with _probe(address) as probe:
            return not probe.recv(1)
    except (OSError, ValueError) as error:
        return isinstance(error, ConnectionResetError)


def is_answered(address: str) -> bool:
    """Return whether a process that runs listens at *address*.

    ZeroMQ greets each new connection. A stopped process does not.
    """
    try:
        with _probe(address) as probe:
            return bool(probe.recv(1))
    except (OSError, ValueError):
        return False


def _probe(address: str) -> sockets.socket:
    """Return a connection. Raises OSError, or ValueError if *address* is malformed."""
    if not address.startswith("ipc://"):
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        return sockets.create_connection((host.strip("[]"), int(port)), _PROBED_WITHIN)
    path = address.removeprefix("ipc://")
    probe = sockets.socket(sockets.AF_UNIX)
    try:
        probe.settimeout(_PROBED_WITHIN)
        probe.connect(f"\0{path[1:]}" if path.startswith("@") else path)
    except OSError:
        probe.close()
        raise
    return probe


class Place:
    """Where this process has last found the central of a list of addresses.

    All connections with the same list share it, so that they move together. Threads of their own
    probe the addresses: the name of a computer that is away may take seconds to resolve.
    """

    def __init__(self, addresses: Sequence[str]) -> None:
        self.address = addresses[0]
        self._addresses = addresses
        self._changed = threading.Condition()
        self._probed: set[str] = set()  #: the addresses that are being probed

    def seek(self, lost: str) -> str:
        """Return an address other than *lost* where central is; *lost* if none was found yet.

        A slow probe continues after the call. A later call returns what it has found.
        """
        with self._changed:
            if self.address == lost:
                for one in self._addresses:
                    if one != lost and one not in self._probed:
                        threading.Thread(target=self._try, args=(one, lost), daemon=True).start()
                        self._probed.add(one)
                self._changed.wait_for(
                    lambda: self.address != lost or not self._probed, _FOUND_AT_ONCE
                )
            return self.address

    def _try(self, address: str, lost: str) -> None:
        """Probe an address; central is there from now on if it answers."""
        is_there = is_answered(address)
        with self._changed:
            self._probed.discard(address)
            if is_there and self.address == lost:
                self.address = address
            self._changed.notify_all()


def place_of(addresses: Sequence[str]) -> Place:
    """Return this process's place of central for a list of addresses."""
    return _place_of(os.getpid(), tuple(addresses))


@functools.cache
def _place_of(_process: int, addresses: tuple[str, ...]) -> Place:
    return Place(addresses)
