"""LocalCentral: the real central inside your own process, for tests of modules without sockets or
processes.

::

    with LocalCentral(stepped=True) as central:
        planner = Module("gait planner", central=central)
        ...
        with planner.running(), connect("test", central) as user:
            user.command(MOVE_LEG, leg_move, delay=60)
            central.advance(60)
            assert central.transcript() == expected

``LocalCentral(check=...)`` is for tests of central itself.
"""

import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, Self

from tca_central.core import Central
from tca_central.events import ConnectionId, ConnectionLost, Event, Record, RequestReceived, Tick
from tca_module import checks
from tca_module.errors import MisuseError, Timeout
from tca_module.sockets.transport import Waker
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry, Fact
from tca_wire.messages.declarations import Message
from tca_wire.packets.codec import pack_item, packets, unpack_to_central
from tca_wire.packets.headers import Closing, Hello, ToModule, Unknown
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import Wording

_QUIET_WITHIN = 5.0  # seconds of real time
_TURN = 1.0  # seconds of real time after which a handler that does not wait for central no longer holds the others up

_BEFORE_ALL = (
    facts.ModuleJoined,
    facts.ResourceChanged,
    facts.FormatDefined,
    facts.HandlerAdded,
    facts.HandlerRemoved,
)
"""Facts of how programs come, which do so at once and in any order."""


class LocalCentral:
    """The core of central, used from any thread.

    With *stepped* its clock stands still but in ``advance``, and of all handlers one runs at a
    time, from one wait for central to the next. What is due at one moment runs in the order in
    which modules began, then as their resources were declared: so the same test has the same
    transcript. With that clock pass delays, deadlines, periods, durations, times that locks wait,
    ``every``, ``after`` and the sleeps of tasks; ``timeout=`` of other waits takes real seconds.
    """

    def __init__(
        self,
        epoch: str = "local",
        *,
        check: Callable[[Central], None] | None = None,
        stepped: bool = False,
    ) -> None:
        """*check* is called with central after every event."""
        self._check = check
        self.is_stepped = stepped
        self.address = f"local central '{epoch}'"
        self.entries: list[Entry] = []  #: the journal
        self.core = Central(epoch)
        self._began = time.monotonic()
        self._stepped_to = 0.0
        self._lock = (
            threading.RLock()
        )  # a LaterReply may be dropped, and so collected, at any instruction
        self._numbers = itertools.count(1)
        self._connections: dict[
            ConnectionId, LocalTransport
        ] = {}  #: on a stepped clock as declared: see Module
        self._is_closed = False
        self._due = threading.Condition(self._lock)
        self._quiet = threading.Condition(self._lock)
        self._clock = threading.Thread(
            target=self._tick, name="clock of the local central", daemon=True
        )
        if not stepped:
            self._clock.start()

    # --- time -------------------------------------------------------------------------------------

    def now(self) -> float:
        """Seconds since central began."""
        return self._stepped_to if self.is_stepped else time.monotonic() - self._began

    def _tick(self) -> None:
        """Let time pass: due timers fire."""
        with self._due:
            while not self._is_closed:
                due, now = self.core.clock.next, self.now()
                if due is not None and due <= now:
                    self._handle(Tick(now))
                else:
                    self._due.wait(None if due is None else due - now)

    def advance(
        self,
        seconds: float,
        *,
        timeout: float = _QUIET_WITHIN,
        ignoring: Collection[Message[Any, Any]] = (),
    ) -> None:
        """Let so many seconds pass on a stepped clock. Whatever is due meanwhile happens at its own
        time, and the next only when all is quiet again. Raises what ``until_quiet`` does.
        """
        if not self.is_stepped:
            raise MisuseError(
                "advance() needs a clock that stands still: make it with LocalCentral(stepped=True)"
            )
        checks.check("advance()", checks.SECONDS, seconds=seconds)
        until = self._stepped_to + seconds
        self.until_quiet(timeout=timeout, ignoring=ignoring)
        while (due := self._next_due()) <= until:
            self._step_to(due)
            self.until_quiet(timeout=timeout, ignoring=ignoring)
        self._step_to(until)

    def _next_due(self) -> float:
        with self._lock:
            callbacks = min((one.due for one in self._connections.values()), default=math.inf)
            return min(
                math.inf if self.core.clock.next is None else self.core.clock.next, callbacks
            )

    def _step_to(self, moment: float) -> None:
        with self._lock:
            self._stepped_to = max(self._stepped_to, moment)
            self._handle(Tick(self._stepped_to))

    # --- quiet ------------------------------------------------------------------------------------

    def until_quiet(
        self, *, timeout: float = _QUIET_WITHIN, ignoring: Collection[Message[Any, Any]] = ()
    ) -> None:
        """Wait until nothing is left to happen that needs no time: every handler has returned, or
        waits for central (a reply, a task, a lock) or, in a coroutine or owing its reply, for
        anything else.

        Threads of your own are not waited for. A handler that sleeps, or waits for something that
        only the test does, is at work: name such messages in *ignoring*. Raises Timeout after
        *timeout* seconds of real time.
        """
        checks.check("until_quiet()", checks.DURATION, timeout=timeout)
        checks.check("until_quiet()", checks.MESSAGES, ignoring=ignoring)
        ignored = {message.name for message in ignoring}
        with self._quiet:
            if not self._quiet.wait_for(lambda: not self._at_work(ignored), timeout):
                busy = " and ".join(self._at_work(ignored)) or "a timer"
                advice = "let it wait for central, or name its message in ignoring="
                raise Timeout(f"not quiet within {timeout:g} s: {busy} is at work: {advice}")

    def _at_work(self, ignored: set[str]) -> list[str]:
        """What has something to do now, in words."""
        handled: dict[ConnectionId, list[str]] = {}
        for delivery in self.core.dispatcher.running.values():
            if delivery.slot is not None:
                handled.setdefault(delivery.slot.id, []).append(delivery.message.name)
        busy = []
        for slot in self._connections.values():
            names = handled.get(slot.id, [])
            if slot.serves and not slot.is_idle and not ignored.intersection(names):
                busy.append(f"the handler of '{names[-1]}'" if names else f"module '{slot.serves}'")
        due = self.core.clock.next
        return busy + ["a timer"] * (due is not None and due <= self.now())

    def may_take(self, transport: "LocalTransport") -> bool:
        """Whether the thread of a connection may have what has come for it. The lock is held."""
        return (
            not (self.is_stepped and transport.serves)
            or transport.has_turn
            or transport.is_overtime
        )

    def look(self) -> None:
        """Something has come, or a thread pauses: whose turn is it? The lock is held."""
        slots = [one for one in self._connections.values() if one.serves] if self.is_stepped else []
        waiting = [one for one in slots if one.is_paused and not one.is_idle]
        if waiting and not any(one.has_turn and not one.is_overtime for one in slots):
            min(
                waiting, key=lambda one: one.packets[0][0] if one.packets else 0
            ).call()  # of equals, the first
        self._quiet.notify_all()

    # --- what happened ----------------------------------------------------------------------------

    @property
    def facts(self) -> list[Fact]:
        """All facts of the journal, in order."""
        with self._lock:
            return [fact for entry in self.entries for fact in entry.facts]

    def transcript(self) -> str:
        """What has happened, a line each, as ``tca log show`` says it; on a stepped clock with the
        time. How modules join and declare is left out.
        """
        with self._lock:
            entries = self.entries[:]
        wording, lines = Wording(), list[str]()
        for entry in entries:
            for fact in entry.facts:
                words, data = wording.words(fact), data_text(getattr(fact, "body", b""))
                if not isinstance(fact, _BEFORE_ALL):
                    start = f"{entry.time:8.3f}  " if self.is_stepped else ""
                    lines.append(
                        f"{start}{facts.kind_of(fact)}: {words}" + (f": {data}" if data else "")
                    )
        return "\n".join([*lines, ""])

    # --- connections ------------------------------------------------------------------------------

    def transport(self) -> "LocalTransport":
        """A new connection."""
        with self._lock:
            transport = LocalTransport(
                self, ConnectionId(b"local %d" % next(self._numbers)), self._lock
            )
            self._connections[transport.id] = transport
            return transport

    def restart(self, epoch: str) -> None:
        """End and begin again with empty memory, as if central had crashed and its journal were
        lost.
        """
        with self._lock:
            self.core = Central(epoch)
            for transport in self._connections.values():
                transport.arrive(pack_item(Closing("restarted")))
            self.look()

    def close(self) -> None:
        """End, with its thread; waiting programs notice. Twice does no harm."""
        with self._due:
            self._is_closed = True
            self._due.notify()
        if not self.is_stepped:
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
                if (
                    isinstance(header, Hello)
                    and header.connection
                    and (known := self._connections.get(connection))
                ):
                    known.serves = header.module
                self._handle(RequestReceived(self.now(), connection, header, body))
            return True

    def cut(self, module: str) -> None:
        """All connections of a module break, as if the network had failed for a moment."""
        with self._lock:
            known = list(self.core.registry.connections.values())
            for connection in [one.id for one in known if one.module.name == module]:
                self._handle(ConnectionLost(self.now(), connection))
                if (transport := self._connections.get(connection)) is not None:
                    transport.arrive(
                        pack_item(Unknown())
                    )  # what is said to those who connect again
            self.look()

    def closed(self, connection: ConnectionId) -> None:
        """The far end of a connection is gone."""
        with self._lock:
            was_open = self._connections.pop(connection, None) is not None
            if was_open and not self._is_closed:
                self._handle(ConnectionLost(self.now(), connection))
            self.look()

    def _handle(self, event: Event) -> None:
        self._let_happen(event)
        while (
            self.is_stepped
            and (due := self.core.clock.next) is not None
            and due <= self._stepped_to
        ):
            self._let_happen(Tick(self._stepped_to))
        self._due.notify()  # something may be due sooner than before
        self.look()

    def _let_happen(self, event: Event) -> None:
        told: dict[LocalTransport, list[tuple[ToModule, bytes]]] = {}
        for effect in self.core.handle(event):
            if isinstance(effect, Record):
                self.entries.append(effect.entry)
            elif transport := self._connections.get(effect.connection):
                told.setdefault(transport, []).append((effect.header, effect.body))
        for transport, items in told.items():
            for _, packet in packets(items):
                transport.arrive(packet)
        if self._check is not None:
            self._check(self.core)


class LocalTransport:
    """One connection to a LocalCentral."""

    def __init__(
        self, central: LocalCentral, connection: ConnectionId, lock: threading.RLock
    ) -> None:
        self.id = connection
        self.serves = ""  #: the module whose messages its thread handles; "": it only sends
        self.is_paused = False  #: its thread waits
        self.has_turn = False  #: its thread was called, and has not paused since
        self._since = time.monotonic()  #: its thread runs
        self.packets: deque[tuple[int, bytes]] = (
            deque()
        )  #: what has come, numbered in the order of all that comes
        self.due = math.inf  #: its thread has a callback to call then; of stepped clocks only
        self._central = central
        self._waker = Waker()
        self._lock = lock
        self._called = threading.Condition(lock)

    @property
    def address(self) -> str:
        """The central's name."""
        return self._central.address

    @property
    def is_idle(self) -> bool:
        """Whether its thread waits and has nothing to do."""
        return self.is_paused and not self.packets and self.due > self._central.now()

    @property
    def is_overtime(self) -> bool:
        """Whether its thread has not paused for long: others need not wait for that."""
        return not self.is_paused and time.monotonic() - self._since > _TURN

    def send(self, packet: bytes, wait_seconds: float) -> bool:  # noqa: ARG002 - central is there at once or never
        """Hand the packet to central."""
        return self._central.take(self.id, packet)

    def arrive(self, packet: bytes) -> None:
        """A packet comes from central; an empty one only ends a wait. The lock is held."""
        self.packets.append((next(_ARRIVALS), packet))
        if self._central.may_take(self):
            self.call()

    def call(self) -> None:
        """Let its thread go on. The lock is held."""
        self._run()
        self.has_turn, self.due = True, math.inf
        self._called.notify()
        self._waker.set()

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        """The next packet; None if there is none in time, ``wake`` was called, or it is the moment
        *alarm*.
        """
        with self._lock:
            if not self._central.is_stepped:
                timeout_seconds = min(timeout_seconds, alarm - self._central.now())
            if timeout_seconds > 0 and not self._may_go_on(alarm):
                self.due = alarm if self._central.is_stepped else math.inf
                self._pause()
                self._called.wait_for(lambda: self._may_go_on(alarm), timeout_seconds)
                self._run()
            while self._has_some():
                _, packet = self.packets.popleft()
                if packet:
                    return packet
        return None

    def _may_go_on(self, alarm: float) -> bool:
        """Whether its thread has something to do, and may. The lock is held."""
        return self._has_some() or (alarm <= self._central.now() and self._central.may_take(self))

    def _has_some(self) -> bool:
        return bool(self.packets) and self._central.may_take(self)

    def _pause(self) -> None:
        self.is_paused, self.has_turn = True, False
        self._central.look()

    def _run(self) -> None:
        if self.is_paused:
            self.is_paused, self._since = False, time.monotonic()

    def time(self) -> float:
        """The seconds of the clock on which callbacks are due."""
        return self._central.now()

    def seconds_until(self, moment: float) -> float:
        """The real seconds to wait for a moment of that clock: for ever, if the test steps it."""
        seconds = moment - self._central.now()
        if not self._central.is_stepped:
            return seconds
        with self._lock:
            if seconds <= 0 and self._central.may_take(self):
                return seconds
            self.due = min(self.due, moment)
        return math.inf

    @contextmanager
    def pausing(self) -> Iterator[None]:
        """A wait of its thread for files, of which this is one."""
        with self._lock:
            self._pause()
        try:
            yield
        finally:
            with self._lock:
                self._run()

    def has_arrived(self) -> bool:
        """Whether there is a packet to receive, or ``wake`` was called since this was asked
        last.
        """
        is_woken = self._waker.clear()
        with self._lock:
            return is_woken or self._has_some()

    def fileno(self) -> int:
        """A file that becomes readable when a packet arrives."""
        return self._waker.fileno()

    def files(self) -> Collection[int]:
        """The file that becomes readable when a packet arrives, or ``wake`` is called."""
        return (self.fileno(),)

    def waker(self) -> Waker:
        """Ends waits from other threads."""
        return self._waker

    def wake(self) -> None:
        """Let ``receive`` return now."""
        with self._lock:
            self.arrive(b"")
            self._central.look()

    def close(self) -> None:
        """Central notices if nobody said goodbye."""
        self._central.closed(self.id)
        self._waker.close()


_ARRIVALS = itertools.count()
