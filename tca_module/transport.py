"""How packets travel between one connection and central. The only file of this package that knows ZeroMQ."""

import functools
from typing import Protocol

import zmq

from tca_module.errors import MisuseError

_OPTIONS = (
    # No routing id: central tells connections apart by Hello, a fixed id can leave a zombie behind (libzmq #2892).
    (zmq.IMMEDIATE, 1),  # refuse to queue for a central that is not there, instead of losing it
    (zmq.SNDHWM, 1000),
    (zmq.LINGER, 1000),
    (zmq.RECONNECT_IVL, 100),
    (zmq.RECONNECT_IVL_MAX, 5000),
    (zmq.HEARTBEAT_IVL, 1000),  # of the network only: a busy handler answers these too
    (zmq.HEARTBEAT_TIMEOUT, 5000),
)


class Transport(Protocol):
    """Carries packets to one central and back; may lose them when the connection breaks, but keeps their order."""

    @property
    def address(self) -> str:
        """Central's address, for people."""

    def send(self, packet: bytes, wait_seconds: float) -> bool:
        """Send, waiting so long for central to be there and take it; whether it left."""

    def receive(self, timeout_seconds: float) -> bytes | None:
        """The next packet; None if there is none in time."""

    def wake(self) -> None:
        """Let ``receive`` return soon, if it can be done from another thread."""

    def close(self) -> None:
        """Close; what was sent still leaves, for a second."""


# As plain integers: combining pyzmq's enum members costs a microsecond each time.
_EVENTS, _POLLIN, _DONTWAIT = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.DONTWAIT)


@functools.cache
def _context() -> "zmq.Context[zmq.Socket[bytes]]":
    """The one ZeroMQ context of this process."""
    return zmq.Context()


class DealerTransport:
    """A DEALER socket."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = _context().socket(zmq.DEALER)
        self._receive_timeout = -1
        for option, value in _OPTIONS:
            self._socket.setsockopt(option, value)
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self._socket.close(linger=0)
            msg = f"{address!r} is no address of central ({error}): 'ipc:///path/of/socket' or 'tcp://host:port' is"
            raise MisuseError(msg) from None

    def send(self, packet: bytes, wait_seconds: float) -> bool:
        """Send, waiting so long for central to be there and take it; whether it left."""
        try:
            self._socket.send(packet, _DONTWAIT)
        except zmq.Again:
            if wait_seconds <= 0 or not self._socket.poll(int(wait_seconds * 1000), zmq.POLLOUT):
                return False
            return self.send(packet, 0)
        return True

    def receive(self, timeout_seconds: float) -> bytes | None:
        """The next packet; None if there is none in time."""
        socket = self._socket
        if timeout_seconds <= 0:
            # Asking is cheaper than the exception that an empty socket raises.
            return socket.recv(_DONTWAIT) if int(socket.getsockopt(_EVENTS)) & _POLLIN else None
        milliseconds = int(timeout_seconds * 1000) + 1  # rounded up: 0 would be a busy wait
        if milliseconds != self._receive_timeout:
            self._receive_timeout = milliseconds
            socket.setsockopt(zmq.RCVTIMEO, milliseconds)
        try:
            return socket.recv()
        except zmq.Again:
            return None

    def wake(self) -> None:
        """Do nothing: a socket belongs to its thread, whose waits are short."""

    def close(self) -> None:
        """Close; what was sent still leaves, for a second."""
        self._socket.close()
