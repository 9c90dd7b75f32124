"""The lines between modules and central, as in ZeroMQ. Packets arrive in order; a line that breaks
loses packets silently.

Each connect gives a line a new routing id. Neither end is notified of a break. Central notices the
break sooner or later; if the module has reconnected before, perhaps never. A module notices that no
packet leaves, or that central does not know the line.
"""

from typing import Protocol

from simulation.clockwork import Clockwork
from simulation.options import Options

from tca_central.events import ConnectionId

PROBE = b""
"""The first packet on each line."""


class Far(Protocol):
    """Central's end."""

    def arrive(self, wire: "Wire", packet: bytes) -> None:
        """Accept a packet that arrives."""

    def see_closed(self, connection: ConnectionId) -> None:
        """Notice a closed line."""


class Near(Protocol):
    """A module's end."""

    name: str

    def receive(self, packet: bytes) -> None:
        """Accept a packet that arrives."""

    def has_line(self) -> None:
        """Continue, because the line is connected."""


class Wire:
    """One line, from connect to break."""

    __slots__ = ("carries_down", "carries_up", "down_at", "id", "socket", "up_at")

    def __init__(self, number: ConnectionId, socket: "Socket", now: float) -> None:
        self.id = number
        self.socket = socket
        self.carries_up = self.carries_down = True
        self.up_at = self.down_at = now  #: arrival of the newest packet in each direction


class Socket:
    """A module's end of a line. The socket reconnects after a break."""

    def __init__(self, network: "Network", owner: Near) -> None:
        self.network, self.owner = network, owner
        self.wire: Wire | None = None
        self.is_closed = False

    def send(self, packet: bytes) -> bool:
        """Send a packet. Return whether it left."""
        return self.wire is not None and self.network.carry_up(self.wire, packet)

    def close(self) -> None:
        """Close the socket. Central notices later. Packets already sent usually still arrive."""
        self.is_closed = True
        wire, self.wire = self.wire, None
        if wire is not None:
            self.network.close(wire)


class Network:
    """All lines of the town."""

    def __init__(self, clockwork: Clockwork, options: Options) -> None:
        self._clockwork, self._options = clockwork, options
        self.central: Far
        self.is_listening = False  #: whether central runs
        self.wires: dict[ConnectionId, Wire] = {}  #: the open lines
        self._sockets: list[Socket] = []
        self._numbers = 0
        self.breaks = 0

    def open(self, owner: Near) -> Socket:
        """Create a socket, which connects soon."""
        socket = Socket(self, owner)
        self._sockets.append(socket)
        self._connect_soon(socket)
        return socket

    def _delay(self) -> float:
        clockwork, longest = self._clockwork, self._options.delay
        return clockwork.between(0.0001, longest if clockwork.chance(0.2) else longest / 10)

    def _connect_soon(self, socket: Socket) -> None:
        # The socket reconnects after 0.1 s or later (``RECONNECT_IVL``).
        self._clockwork.after(self._clockwork.between(0.1, 0.5), self._connect, socket)

    def _connect(self, socket: Socket) -> None:
        if socket.is_closed or socket.wire is not None:
            return
        if not self.is_listening:
            self._connect_soon(socket)
            return
        self._numbers += 1
        wire = socket.wire = Wire(
            ConnectionId(b"\0%d" % self._numbers), socket, self._clockwork.now
        )
        self.wires[wire.id] = wire
        self.carry_up(wire, PROBE)
        socket.owner.has_line()

    # --- packets ----------------------------------------------------------------------------------

    def carry_up(self, wire: Wire, packet: bytes) -> bool:
        """Send a packet to central."""
        wire.up_at = max(wire.up_at, self._clockwork.now + self._delay())
        self._clockwork.after(wire.up_at - self._clockwork.now, self._arrive_up, wire, packet)
        return True

    def _arrive_up(self, wire: Wire, packet: bytes) -> None:
        if wire.carries_up and self.wires.get(wire.id) is wire:
            self.central.arrive(wire, packet)

    def carry_down(self, connection: ConnectionId, packet: bytes) -> bool:
        """Send a packet to a module. Return False if the line has ended."""
        wire = self.wires.get(connection)
        if wire is None:
            return False
        wire.down_at = max(wire.down_at, self._clockwork.now + self._delay())
        self._clockwork.after(wire.down_at - self._clockwork.now, self._arrive_down, wire, packet)
        return True

    def _arrive_down(self, wire: Wire, packet: bytes) -> None:
        if wire.carries_down and wire.socket.wire is wire:
            wire.socket.owner.receive(packet)

    # --- faults -----------------------------------------------------------------------------------

    def break_one(self) -> None:
        """Break a line; packets under way in both directions are lost."""
        wires = [socket.wire for socket in self._sockets if socket.wire is not None]
        if wires:
            self.cut(self._clockwork.dice.choice(wires))

    def cut(self, wire: Wire) -> None:
        clockwork = self._clockwork
        self.breaks += 1
        clockwork.trace(wire.socket.owner.name, f"line {_words(wire.id)} breaks")
        wire.carries_up = wire.carries_down = False
        wire.socket.wire = None
        # A half-open line swallows packets until the operating system ends it.
        if clockwork.chance(0.5):
            self._end(wire) if clockwork.chance(0.5) else clockwork.after(
                clockwork.between(0.0, 0.5), self._end, wire
            )
        else:
            clockwork.after(clockwork.between(0.0, self._options.half_open), self._end, wire)
        self._connect_soon(wire.socket)

    def close(self, wire: Wire) -> None:
        """Close the module's end of a line. Packets to central usually still arrive."""
        clockwork = self._clockwork
        wire.carries_down = False
        self._sockets.remove(wire.socket)
        at = max(wire.up_at, clockwork.now) if clockwork.chance(0.7) else clockwork.now
        clockwork.after(at - clockwork.now + clockwork.between(0.0, 0.5), self._end, wire)

    def _end(self, wire: Wire) -> None:
        if self.wires.get(wire.id) is wire:
            del self.wires[wire.id]
            self.central.see_closed(wire.id)

    def lose_central(self) -> None:
        """End all lines, because central's process has ended. Modules may still receive earlier
        packets.
        """
        self.is_listening = False
        self._numbers *= not self._options.ids_again
        for wire in self.wires.values():
            wire.carries_up = False
            if wire.socket.wire is wire:
                is_lost = self._clockwork.chance(0.5)
                self._clockwork.after(
                    0.0 if is_lost else max(wire.down_at - self._clockwork.now, 0.0),
                    self._drop,
                    wire,
                )
        self.wires.clear()

    def _drop(self, wire: Wire) -> None:
        wire.carries_down = False
        if wire.socket.wire is wire:
            wire.socket.wire = None
            self._connect_soon(wire.socket)


def _words(connection: ConnectionId) -> str:
    return connection[1:].decode()
