"""The lines of a town whose central is one of several members: each listens at an address of its
own, and a module looks for the one that leads.
"""

from typing import Any

from simulation.clockwork import Clockwork
from simulation.network import Near, Network, Socket
from simulation.options import Options

UNANSWERED = 1.0
"""Seconds without an answer after which a module looks for central elsewhere."""
SILENT = 3.0
"""Seconds without a heartbeat after which it does."""
_PERIOD = 0.5


class Door(Network):
    """The address of one member."""

    def __init__(self, clockwork: Clockwork, options: Options, harbour: "Harbour") -> None:
        super().__init__(clockwork, options)
        self._sockets, self._harbour = harbour.sockets, harbour
        self.beat_at = 0.0  #: when the member has last sent heartbeats

    def _connect_soon(self, socket: Socket) -> None:
        self._harbour.connect_soon(socket)

    def leave(self, socket: Socket) -> None:
        """Close a module's line, because the module looks for central elsewhere."""
        wire, socket.wire = socket.wire, None
        if wire is not None:
            wire.carries_down = False
            wire.carries_up = wire.carries_up and self._clockwork.chance(0.5)
            self._clockwork.after(self._clockwork.between(0.0, 0.5), self._end, wire)


class Harbour:
    """All addresses, and the lines to them."""

    def __init__(self, clockwork: Clockwork, options: Options, number: int) -> None:
        self._clockwork = clockwork
        self.sockets: list[Socket] = []
        self.doors = [Door(clockwork, options, self) for _ in range(number)]
        self.moves = 0
        clockwork.after(_PERIOD, self._seek)

    @property
    def is_listening(self) -> bool:
        """Whether one member listens, and no other."""
        return sum(door.is_listening for door in self.doors) == 1

    @property
    def breaks(self) -> int:
        """The number of broken lines."""
        return sum(door.breaks for door in self.doors)

    def open(self, owner: Near) -> Socket:
        """Create a socket, which connects soon."""
        socket = Socket(self.doors[0], owner)
        self.sockets.append(socket)
        self.connect_soon(socket)
        return socket

    def connect_soon(self, socket: Socket) -> None:
        """Connect a socket to an address at which a member listens."""
        self._clockwork.after(self._clockwork.between(0.1, 0.5), self._connect, socket)

    def _connect(self, socket: Socket) -> None:
        if socket.is_closed or socket.wire is not None:
            return
        if listening := [door for door in self.doors if door.is_listening]:
            door = self._clockwork.dice.choice(listening)
            socket.network = door
            door._connect(socket)
        else:
            self.connect_soon(socket)

    def break_one(self) -> None:
        """Break a line."""
        wires = [socket.wire for socket in self.sockets if socket.wire is not None]
        if wires:
            wire = self._clockwork.dice.choice(wires)
            wire.socket.network.cut(wire)

    def _seek(self) -> None:
        """Let modules whose central is silent look for it elsewhere."""
        self._clockwork.after(_PERIOD, self._seek)
        now = self._clockwork.now
        for socket in [one for one in self.sockets if one.wire is not None]:
            door, thread = socket.network, _thread_of(socket)
            assert isinstance(door, Door)
            session = thread.session
            is_unanswered = session.heard < session.probed_since <= now - UNANSWERED
            others = [one for one in self.doors if one is not door and one.is_listening]
            if not others or thread.is_busy or not (is_unanswered or now > door.beat_at + SILENT):
                continue
            self.moves += 1
            self._clockwork.trace(thread.name, "looks for central elsewhere")
            door.leave(socket)
            socket.network = other = self._clockwork.dice.choice(others)
            session.break_off()
            other._connect(socket)


def _thread_of(socket: Socket) -> Any:
    return socket.owner
