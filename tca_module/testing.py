"""LocalCentral: the real central inside your own process, for tests of modules without sockets or processes.

::

with LocalCentral() as central:
    planner = Module("gait planner", central=central)
    ...
    with planner.running(), connect("test", central) as user:
        assert user.command(MOVE_LEG, leg_move).result(timeout=5) == footfall

``LocalCentral(check=True)`` is for tests of central itself.
"""

import itertools
import queue
import threading
import time
from typing import Self

from tca_central.core import Central
from tca_central.events import ConnectionId, ConnectionLost, Event, Record, RequestReceived, Tick
from tca_central.invariants import check_invariants
from tca_module.sockets.transport import Waker
from tca_wire.journal.facts import Entry, Fact
from tca_wire.packets.codec import pack_item, packets, unpack_to_central
from tca_wire.packets.headers import Closing, ToModule


class LocalCentral:
    """The core of central, used from any thread."""

    def __init__(self, epoch: str = "local", *, check: bool = False) -> None:
        """With *check* central's own invariants are checked after every event, for small trees (AssertionError)."""
        self._is_checked = check
        self.address = f"local central '{epoch}'"
        self.entries: list[Entry] = []  #: the journal
        self.core = Central(epoch)
        self._began = time.monotonic()
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        self._connections: dict[ConnectionId, LocalTransport] = {}
        self._is_closed = False
        self._due = threading.Condition(self._lock)
        self._clock = threading.Thread(target=self._tick, name="clock of the local central", daemon=True)
        self._clock.start()

    def _tick(self) -> None:
        """Let time pass: due timers fire."""
        with self._due:
            while not self._is_closed:
                due, now = self.core.clock.next, time.monotonic() - self._began
                if due is not None and due <= now:
                    self._handle(Tick(now))
                else:
                    self._due.wait(None if due is None else due - now)

    @property
    def facts(self) -> list[Fact]:
        """All facts of the journal, in order."""
        with self._lock:
            return [fact for entry in self.entries for fact in entry.facts]

    def transport(self) -> "LocalTransport":
        """A new connection."""
        with self._lock:
            transport = LocalTransport(self, ConnectionId(b"local %d" % next(self._numbers)))
            self._connections[transport.id] = transport
            return transport

    def restart(self, epoch: str) -> None:
        """End and begin again with empty memory, as if central had crashed and its journal were lost."""
        with self._lock:
            self.core = Central(epoch)
            for transport in self._connections.values():
                transport.arrive(pack_item(Closing("restarted")))

    def close(self) -> None:
        """End, with its thread; waiting programs notice. Twice does no harm."""
        with self._due:
            self._is_closed = True
            self._due.notify()
        self._clock.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def take(self, connection: ConnectionId, packet: bytes) -> bool:
        """A packet arrives from a connection; whether somebody was there to take it."""
        with self._lock:
            if self._is_closed:
                return False
            for header, body in unpack_to_central(packet):
                self._handle(RequestReceived(time.monotonic() - self._began, connection, header, body))
            return True

    def cut(self, module: str) -> None:
        """All connections of a module break, as if the network had failed for a moment."""
        with self._lock:
            known = list(self.core.registry.connections.values())
            for connection in [one.id for one in known if one.module.name == module]:
                self._handle(ConnectionLost(time.monotonic() - self._began, connection))

    def closed(self, connection: ConnectionId) -> None:
        """The far end of a connection is gone."""
        with self._lock:
            was_open = self._connections.pop(connection, None) is not None
            if was_open and not self._is_closed:
                self._handle(ConnectionLost(time.monotonic() - self._began, connection))

    def _handle(self, event: Event) -> None:
        told: dict[LocalTransport, list[tuple[ToModule, bytes]]] = {}
        for effect in self.core.handle(event):
            if isinstance(effect, Record):
                self.entries.append(effect.entry)
            elif transport := self._connections.get(effect.connection):
                told.setdefault(transport, []).append((effect.header, effect.body))
        for transport, items in told.items():
            for _, packet in packets(items):
                transport.arrive(packet)
        self._due.notify()  # something may be due sooner than before
        if self._is_checked:
            check_invariants(self.core)


class LocalTransport:
    """One connection to a LocalCentral."""

    def __init__(self, central: LocalCentral, connection: ConnectionId) -> None:
        self.id = connection
        self.incoming: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._central = central
        self._waker: Waker | None = None

    @property
    def address(self) -> str:
        """The central's name."""
        return self._central.address

    def send(self, packet: bytes, wait_seconds: float) -> bool:  # noqa: ARG002 - central is there at once or never
        """Hand the packet to central."""
        return self._central.take(self.id, packet)

    def arrive(self, packet: bytes) -> None:
        """A packet comes from central; an empty one only ends a wait."""
        self.incoming.put(packet)
        if self._waker is not None:
            self._waker.set()

    def receive(self, timeout_seconds: float) -> bytes | None:
        """The next packet; None if there is none in time, or ``wake`` was called."""
        try:
            packet = self.incoming.get(timeout=timeout_seconds) if timeout_seconds > 0 else self.incoming.get_nowait()
            while not packet:
                packet = self.incoming.get_nowait()
        except queue.Empty:
            return None
        return packet

    def has_arrived(self) -> bool:
        """Whether there is a packet to receive, or ``wake`` was called since this was asked last."""
        is_woken = self._waker is not None and self._waker.clear()
        return is_woken or not self.incoming.empty()

    def fileno(self) -> int:
        """A file that becomes readable when a packet arrives."""
        return self.waker().fileno()

    def waker(self) -> Waker:
        """Ends waits from other threads."""
        if self._waker is None:
            self._waker = Waker()
        return self._waker

    def wake(self) -> None:
        """Let ``receive`` return now."""
        self.arrive(b"")

    def close(self) -> None:
        """Central notices if nobody said goodbye."""
        self._central.closed(self.id)
        if self._waker is not None:
            self._waker.close()
