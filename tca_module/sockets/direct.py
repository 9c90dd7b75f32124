"""The sockets of direct messages: a slot's entrance, and a sender's path to an entrance.

Every program that reaches central can reach an entrance. The entrance is a file in the folder of
central's socket, or listens on the network interface through which this computer reaches central.
If central requires keys, the entrance has a key of its own. Central gives its public key to
permitted senders.
"""

import contextlib
import os
import socket as sockets
from pathlib import Path
from secrets import token_hex

import zmq

from tca_module.sockets.curve import key_for, make_server, use_server_key
from tca_module.sockets.pulse import KEEPALIVE
from tca_module.sockets.transport import DONTWAIT, EVENTS, POLLIN, SNDMORE, context
from tca_wire.packets.routes import Entrance
from tca_wire.vocabulary import Limit

MOST_UNDER_WAY = 1000  # messages under way from a sender to an entrance, at most

_OPTIONS = (
    (zmq.SNDHWM, MOST_UNDER_WAY + 100),  # never reached, because senders count their messages
    (zmq.RCVHWM, MOST_UNDER_WAY + 100),
    (zmq.LINGER, 1000),
    (zmq.MAXMSGSIZE, int(Limit.PACKET)),
    (zmq.HANDSHAKE_IVL, 2000),
    *KEEPALIVE,  # without ZeroMQ heartbeats (see transport.py): senders greet instead
)
_LONGEST_PATH = 100  # bytes in the path of a Unix socket; systems allow 103 to 107
_SUFFIX = ".direct"
_POLLOUT = int(zmq.POLLOUT)

Address = bytes
"""The routing id by which an entrance knows a sender's connection."""


class _DirectSocket:
    """A ZeroMQ socket for direct messages. *kind*: the type of socket, such as zmq.DEALER."""

    def __init__(self, kind: int) -> None:
        self._socket: zmq.Socket[bytes] = context().socket(kind)
        for option, value in _OPTIONS:
            self._socket.setsockopt(option, value)

    def _can(self, event: int) -> bool:
        return bool(int(self._socket.getsockopt(EVENTS)) & event)

    def fileno(self) -> int:
        """Return the file that becomes readable when something arrives."""
        return int(self._socket.getsockopt(zmq.FD))

    def has_arrived(self) -> bool:
        """Return whether there is a packet to receive."""
        return self._can(POLLIN)

    def close(self) -> None:
        """Close. Packets already sent still leave, for a second."""
        self._socket.close()


class EntranceSocket(_DirectSocket):
    """The socket on which a slot receives direct messages. Raises OSError if it can't be opened."""

    def __init__(self, central: str) -> None:
        super().__init__(zmq.ROUTER)
        self.is_paused = False  #: while true, packets stay in the socket
        # senders need the key to connect
        public_key = make_server(self._socket) if key_for(central) is not None else ""
        self._socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
        try:
            endpoint = _bind(self._socket, central)
        except (OSError, ValueError) as error:  # ZMQError is an OSError
            self._socket.close(linger=0)
            raise OSError(str(error)) from None
        #: the entrance as central announces it
        self.entrance = Entrance(endpoint, token_hex(16), public_key)

    def has_arrived(self) -> bool:
        """Return whether there is a packet to receive, and receiving is not paused."""
        return self._can(POLLIN) and not self.is_paused

    def receive(self) -> tuple[Address, list[bytes]] | None:
        """Return the sender and the frames of the next packet, or None."""
        if not self._can(POLLIN):
            return None
        address, *frames = self._socket.recv_multipart(DONTWAIT)
        return address, frames

    def send(self, to: Address, packet: bytes) -> bool:
        """Send a packet; return whether it left."""
        try:
            self._socket.send(to, SNDMORE)
            self._socket.send(packet, DONTWAIT)
        except zmq.ZMQError:  # the sender has disconnected, or does not read
            return False
        return True

    def close(self) -> None:
        """Close and remove the socket file. Packets already sent still leave, for a second."""
        super().close()
        if self.entrance.endpoint.startswith("ipc://"):
            Path(self.entrance.endpoint.removeprefix("ipc://")).unlink(missing_ok=True)


class PathSocket(_DirectSocket):
    """A sender's socket to one entrance. Raises OSError if the endpoint is not an address."""

    def __init__(self, entrance: Entrance) -> None:
        super().__init__(zmq.DEALER)
        # Without the option IMMEDIATE, packets for a disconnected slot wait here. The sender's
        # count bounds their number. With the option, libzmq 4.3.5 would discard unread packets when
        # the far end closes. These may be the last answers of a slot.
        self._socket.setsockopt(zmq.RECONNECT_IVL_MAX, 5000)
        try:
            if entrance.curve:
                use_server_key(self._socket, entrance.curve)
            self._socket.connect(entrance.endpoint)
        except OSError:
            self._socket.close(linger=0)
            raise

    @property
    def is_connected(self) -> bool:
        """Whether the socket accepts a packet now."""
        return self._can(_POLLOUT)

    def receive(self) -> bytes | None:
        """Return the next packet, or None."""
        return self._socket.recv(DONTWAIT) if self._can(POLLIN) else None

    def send(self, packet: bytes) -> bool:
        """Send a packet; return whether it left."""
        try:
            self._socket.send(packet, DONTWAIT)
        except zmq.Again:
            return False
        return True


def _bind(socket: "zmq.Socket[bytes]", central: str) -> str:
    """Listen where every program that reaches *central* can reach this socket.

    Returns the endpoint.
    """
    if central.startswith("tcp://"):
        name, _, port = central.removeprefix("tcp://").rpartition(":")
        family, _, _, _, address = sockets.getaddrinfo(
            name.strip("[]"), int(port), type=sockets.SOCK_DGRAM
        )[0]
        with sockets.socket(family, sockets.SOCK_DGRAM) as probe:
            probe.connect(address)  # sends nothing
            host = str(probe.getsockname()[0])  # this computer's address towards central
        socket.setsockopt(zmq.IPV6, int(":" in host))
        socket.bind(f"tcp://{f'[{host}]' if ':' in host else host}:*")
        return socket.get_string(zmq.LAST_ENDPOINT)
    folder = Path(central.removeprefix("ipc://")).parent
    if not central.startswith("ipc:///"):
        raise ValueError(f"central's address {central!r} has no folder for the socket")
    _remove_stale_sockets(folder)
    path = folder / f"{os.getpid()}-{token_hex(4)}{_SUFFIX}"
    if len(os.fsencode(path)) > _LONGEST_PATH:
        raise ValueError(f"{path} is too long for a socket")
    socket.bind(f"ipc://{path}")
    path.chmod(0o600)
    return f"ipc://{path}"


def _remove_stale_sockets(folder: Path) -> None:
    """Remove the socket files of processes that were killed."""
    for path in folder.glob(f"*{_SUFFIX}"):
        try:
            os.kill(int(path.name.partition("-")[0]), 0)  # signal 0 only tests for the process
        except ProcessLookupError:
            with contextlib.suppress(OSError), sockets.socket(sockets.AF_UNIX) as probe:
                try:
                    probe.connect(str(path))  # the process may run on another computer
                except ConnectionRefusedError:
                    path.unlink(missing_ok=True)
        except (ValueError, OverflowError, PermissionError):
            continue  # not a file of ours
