"""LocalCentral: the real central inside your own process, for tests without sockets or processes.

Example::

    with LocalCentral(stepped=True) as central:
        move_leg = central.fake(MOVE_LEG)
        central.start(gait_planner)
        gait_planner.goal(TAKE_STEPS, arc, delay=60)
        central.advance(60)
        assert move_leg.calls == expected
"""

import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from tca_central.core import Central
from tca_central.events import ConnectionId, ConnectionLost, Event, Record, RequestReceived, Tick
from tca_module import checks
from tca_module.errors import CentralLost, MisuseError, Timeout
from tca_module.module import Module
from tca_module.rig import Rig
from tca_module.sockets.transport import OneAddress, Waker
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry, Fact
from tca_wire.journal.records import record
from tca_wire.messages.declarations import Message
from tca_wire.packets.codec import pack_item, packets, unpack_to_central
from tca_wire.packets.headers import Closing, Hello, ToModule, Unknown
from tca_wire.release import release
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import Wording

_QUIET_WITHIN = 5.0  # seconds of real time
_TURN_SECONDS = 1.0  # real seconds after which the other handlers no longer wait for a handler

_BEFORE_ALL = (
    facts.ModuleJoined,
    facts.ResourceChanged,
    facts.FormatDefined,
    facts.HandlerAdded,
    facts.HandlerRemoved,
)
"""Facts of the joining of programs. Programs may join at the same time, in any order."""


class LocalCentral(Rig):
    """The core of central in the process of a test. Any thread may use it.

    With *stepped*, the clock of central stands still except in ``advance()``. One handler runs at a
    time, until it waits for central again. Handlers that are due at the same time run in the order
    in which their modules started, then in the order of their resources. Therefore the same test
    has the same transcript. Delays, deadlines, periods, durations, waits for locks, ``every``,
    ``after`` and the sleeps of tasks use the stepped clock. ``timeout=`` of other waits takes real
    seconds.

    A message holds at most 8 MiB, because no memory is shared.

    Args:
        epoch: the name of this run of central. Default: "local".
        check: a function that is called with the core of central after every event; for tests of
            central itself. Default: None.
        stepped: the test steps the clock. Default: False, the real clock.

    Attributes:
        entries: the journal.
        core: the core of central.
        address: the name of this central, for people.
        is_stepped: whether the test steps the clock.

    Example::

        with LocalCentral(stepped=True) as central, connect("test", central) as user:
            fetch = user.goal(FETCH, "cup", delay=2.5)
            central.advance(2.5)
    """

    def __init__(
        self,
        epoch: str = "local",
        *,
        check: Callable[[Central], None] | None = None,
        stepped: bool = False,
    ) -> None:
        super().__init__(self)
        self._check = check
        self.is_stepped = stepped
        self.address = f"local central '{epoch}'"
        self.entries: list[Entry] = []
        self.core = Central(epoch)
        self._started = time.monotonic()
        self._stepped_to = 0.0
        # Reentrant, because a LaterReply may be garbage collected at any instruction, even while
        # this thread has the lock. The LaterReply then sends an answer, which takes the lock.
        self._lock = threading.RLock()
        self._numbers = itertools.count(1)
        # On a stepped clock, the slots stand in the order of declaration: see Module._open_slots.
        self._connections: dict[ConnectionId, LocalTransport] = {}
        self.is_closed = False  #: no call can be answered any more
        self._due = threading.Condition(self._lock)
        self._quiet = threading.Condition(self._lock)
        self._clock = threading.Thread(
            target=self._tick, name="clock of the local central", daemon=True
        )
        if not stepped:
            self._clock.start()

    def _check_required(self, module: Module) -> None:
        known = self.core.registry.messages
        with self._lock:
            handled = [name for name, message in known.items() if message.handlers]
        missing = [one.name for one in module.required_elsewhere() if one.name not in handled]
        if missing:
            text = f"module '{module.name}' requires {checks.quoted(missing)}"
            advice = "start the module that handles it first, or fake() the message"
            raise MisuseError(f"start(): {text}, which no module handles: {advice}")

    # --- time -------------------------------------------------------------------------------------

    def now(self) -> float:
        """Return the seconds since central started."""
        return self._stepped_to if self.is_stepped else time.monotonic() - self._started

    def _tick(self) -> None:
        """Fire the timers that are due, in a thread of the real clock."""
        with self._due:
            while not self.is_closed:
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
        """Advance a stepped clock by *seconds*.

        The clock stops at each time at which something is due, and waits there until all is quiet.

        Args:
            seconds: 0 or more.
            timeout: the most seconds of real time to wait for quiet each time. Default: 5.
            ignoring: messages whose handlers count as quiet. Default: none.

        Raises:
            Timeout: a handler is still at work; see ``until_quiet``.
            MisuseError: the clock is not stepped, or an argument is wrong.

        Example::

            central.advance(0.5)
            assert not walk.info()
        """
        if not self.is_stepped:
            advice = "make it with LocalCentral(stepped=True)"
            raise MisuseError(f"advance() needs a stepped clock: {advice}")
        checks.check("advance()", checks.SECONDS, seconds=seconds)
        until = self._stepped_to + seconds
        self.until_quiet(timeout=timeout, ignoring=ignoring)
        while (due := self._next_due()) <= until:
            self._step_to(due)
            self.until_quiet(timeout=timeout, ignoring=ignoring)
        self._step_to(until)

    def _next_due(self) -> float:
        """Return when the next timer or callback is due."""
        with self._lock:
            timer = self.core.clock.next
            callbacks = min((one.due for one in self._connections.values()), default=math.inf)
            return callbacks if timer is None else min(timer, callbacks)

    def _step_to(self, moment: float) -> None:
        """Set the clock to the time *moment*, and fire the due timers."""
        with self._lock:
            self._stepped_to = max(self._stepped_to, moment)
            self._handle(Tick(self._stepped_to))

    # --- quiet ------------------------------------------------------------------------------------

    def until_quiet(
        self, *, timeout: float = _QUIET_WITHIN, ignoring: Collection[Message[Any, Any]] = ()
    ) -> None:
        """Wait until nothing more can happen before the next timer or callback is due.

        Every handler has then returned, or waits for central (a reply, a task, a lock). A coroutine
        that awaits anything is quiet. A handler that owes its reply is quiet, too. This call does
        not wait for threads of your own. A handler that sleeps by ``time.sleep``, computes, or
        waits for the test itself is at work: name its message in *ignoring*.

        Args:
            timeout: the most seconds of real time to wait. Default: 5.
            ignoring: messages whose handlers count as quiet. Default: none.

        Raises:
            Timeout: a handler is still at work; the text names it.
            MisuseError: an argument is wrong.

        Example::

            fetch = user.goal(FETCH, "cup")
            central.until_quiet()
            assert fetch.wait(timeout=0) is Outcome.DONE
        """
        checks.check("until_quiet()", checks.DURATION, timeout=timeout)
        checks.check("until_quiet()", checks.MESSAGES, ignoring=ignoring)
        ignored = {message.name for message in ignoring}
        with self._quiet:
            if not self._quiet.wait_for(lambda: not self._describe_busy(ignored), timeout):
                busy = " and ".join(self._describe_busy(ignored)) or "a timer"
                advice = "let it wait for central, or name its message in ignoring="
                raise Timeout(f"not quiet within {timeout:g} s: {busy} is at work: {advice}")

    def _describe_busy(self, ignored: set[str]) -> list[str]:
        """Describe the handlers, modules and timers that have something to do now."""
        handled: dict[ConnectionId, list[str]] = {}
        for delivery in self.core.dispatcher.running.values():
            if delivery.slot is not None:
                handled.setdefault(delivery.slot.id, []).append(delivery.message.name)
        busy = []
        for slot in self._connections.values():
            names = handled.get(slot.id, [])
            if slot.serves and not slot.is_idle and not ignored.intersection(names):
                busy.append(f"the handler of '{names[-1]}'" if names else f"module '{slot.serves}'")
        return busy + ["a timer"] * self._has_due_timer()

    def _has_due_timer(self) -> bool:
        due = self.core.clock.next
        return due is not None and due <= self.now()

    def may_receive(self, transport: "LocalTransport") -> bool:
        """Whether a connection's thread may receive packets now. The caller holds the lock."""
        needs_turn = self.is_stepped and transport.serves
        return not needs_turn or transport.has_turn or transport.is_overtime

    def schedule(self) -> None:
        """Give the next thread its turn, after a packet has arrived or a thread has paused.

        The caller holds the lock.
        """
        slots = [one for one in self._connections.values() if one.serves] if self.is_stepped else []
        waiting = [one for one in slots if one.is_paused and not one.is_idle]
        if waiting and not any(one.has_turn and not one.is_overtime for one in slots):
            # A slot whose callback is due comes first, then the slot whose packet arrived first.
            min(waiting, key=lambda one: one.packets[0][0] if one.packets else 0).give_turn()
        self._quiet.notify_all()

    # --- the journal ------------------------------------------------------------------------------

    @property
    def facts(self) -> list[Fact]:
        """All facts of the journal, in order."""
        with self._lock:
            return [fact for entry in self.entries for fact in entry.facts]

    def transcript(self) -> str:
        """Return a line for each fact, as ``tca log show`` prints it.

        On a stepped clock a line starts with the time. The joining of modules and their
        declarations are left out.
        """
        with self._lock:
            entries = self.entries[:]
        wording, lines = Wording(), list[str]()
        for entry in entries:
            for fact in entry.facts:
                # Also for facts that are left out, because the wording remembers their names.
                words, data = wording.words(fact), data_text(getattr(fact, "body", b""))
                if not isinstance(fact, _BEFORE_ALL):
                    start = f"{entry.time:8.3f}  " if self.is_stepped else ""
                    line = f"{start}{facts.kind_of(fact)}: {words}"
                    lines.append(f"{line}: {data}" if data else line)
        return "\n".join([*lines, ""])

    def save(self, path: Path | str) -> None:
        """Write the journal to a file, for ``tca log``, ``tca tree`` and the other tools.

        Args:
            path: the file, whose name must end in ".tcaj".

        Raises:
            OSError: the file can't be written.

        Example::

            central.save(tmp_path / "journal.tcaj")
        """
        with self._lock:
            entries, began = self.entries[:], time.time() - self.now()
        opened = facts.Opened(facts.JOURNAL_VERSION, self.core.epoch, 1, began, release())
        Path(path).write_bytes(b"".join(map(record, [Entry(0, 0.0, [opened]), *entries])))

    # --- connections ------------------------------------------------------------------------------

    def transport(self) -> "LocalTransport":
        """Return a new connection, for the library."""
        with self._lock:
            connection = ConnectionId(b"local %d" % next(self._numbers))
            transport = LocalTransport(self, connection, self._lock)
            self._connections[transport.id] = transport
            return transport

    def restart(self, epoch: str) -> None:
        """Restart with empty memory, as if central had crashed and lost its journal.

        Args:
            epoch: the name of the new run.
        """
        with self._lock:
            self.core = Central(epoch)
            for transport in self._connections.values():
                transport.arrive(pack_item(Closing("restarted")))
            self.schedule()

    def close(self) -> None:
        """End the modules and fakes, central and its thread. Closing again does nothing.

        Later calls of clients raise CentralLost.
        """
        try:
            super().close()
        finally:
            self._end()

    def _end(self) -> None:
        with self._due:
            self.is_closed = True
            self._due.notify()
        if not self.is_stepped:
            self._clock.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def submit(self, connection: ConnectionId, packet: bytes) -> bool:
        """Handle a packet from a connection. Returns False if central is closed."""
        with self._lock:
            if self.is_closed:
                return False
            for header, body in unpack_to_central(packet):
                known = self._connections.get(connection)
                if known is not None and isinstance(header, Hello) and header.connection:
                    known.serves = header.module
                self._handle(RequestReceived(self.now(), connection, header, body))
            return True

    def cut(self, module: str) -> None:
        """Break all connections of a module, as if the network had failed for a moment.

        Args:
            module: the module's name.
        """
        with self._lock:
            known = list(self.core.registry.connections.values())
            for connection in [one.id for one in known if one.module.name == module]:
                self._handle(ConnectionLost(self.now(), connection))
                if (transport := self._connections.get(connection)) is not None:
                    transport.arrive(pack_item(Unknown()))  # central's answer to a reconnection
            self.schedule()

    def disconnect(self, connection: ConnectionId) -> None:
        """Handle the end of a connection."""
        with self._lock:
            was_open = self._connections.pop(connection, None) is not None
            if was_open and not self.is_closed:
                self._handle(ConnectionLost(self.now(), connection))
            self.schedule()

    def _handle(self, event: Event) -> None:
        """Handle an event, and the timers that are due."""
        self._apply_event(event)
        while self.is_stepped and self._has_due_timer():
            self._apply_event(Tick(self._stepped_to))
        self._due.notify()  # a timer may be due sooner than before
        self.schedule()

    def _apply_event(self, event: Event) -> None:
        """Handle one event: record its facts, and deliver its messages."""
        outgoing: dict[LocalTransport, list[tuple[ToModule, bytes]]] = {}
        for effect in self.core.handle(event):
            if isinstance(effect, Record):
                self.entries.append(effect.entry)
            elif transport := self._connections.get(effect.connection):
                outgoing.setdefault(transport, []).append((effect.header, effect.body))
        for transport, items in outgoing.items():
            for _, packet in packets(items):
                transport.arrive(packet)
        if self._check is not None:
            self._check(self.core)


class LocalTransport(OneAddress):
    """One connection to a LocalCentral."""

    hold_seconds = 0.0  # a packet costs nothing here

    def __init__(
        self, central: LocalCentral, connection: ConnectionId, lock: threading.RLock
    ) -> None:
        self.id = connection
        self.address = central.address  #: the central's name, for people
        self.is_stepped = central.is_stepped
        self.serves = ""  #: the module whose messages the thread handles; "" if it only sends
        self.is_paused = False  #: the thread of this connection waits
        self.has_turn = False  #: the thread was given a turn, and has not paused since
        self._since = time.monotonic()  #: when the thread last continued
        #: The packets that have arrived, with their numbers in the order of all arrivals.
        self.packets: deque[tuple[int, bytes]] = deque()
        #: the time at which a callback or the end of a sleep is due; infinite on a real clock
        self.due = math.inf
        self._central = central
        self._waker = Waker()
        self._lock = lock
        self._continues = threading.Condition(lock)  #: notified when the thread gets a turn

    @property
    def is_idle(self) -> bool:
        """Whether the connection's thread waits and has nothing to do."""
        return self.is_paused and not self.packets and self.due > self._central.now()

    @property
    def is_overtime(self) -> bool:
        """Whether the thread has run for more than a second: other threads then wait no longer."""
        return not self.is_paused and time.monotonic() - self._since > _TURN_SECONDS

    def send(self, packet: bytes, wait_seconds: float) -> bool:  # noqa: ARG002
        """Pass the packet to central."""
        return self._central.submit(self.id, packet)

    def arrive(self, packet: bytes) -> None:
        """Add a packet from central; an empty one only ends a wait. The caller holds the lock."""
        self.packets.append((next(_ARRIVALS), packet))
        if self._central.may_receive(self):
            self.give_turn()

    def give_turn(self) -> None:
        """Allow the connection's thread to continue. The caller holds the lock."""
        self._resume()
        self.has_turn, self.due = True, math.inf
        self._continues.notify()
        self._waker.set()

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        """Return the next packet.

        Returns None if no packet arrives in time, if ``wake`` is called, or when the handlers'
        clock reaches *alarm*. Raises CentralLost for a caller who would wait for a closed central.
        """
        with self._lock:
            waits = timeout_seconds > 0 and not (self.packets or self.serves)
            if waits and self._central.is_closed:
                raise CentralLost(f"{self.address} is closed: make the call before its end")
            if not self._central.is_stepped:
                timeout_seconds = min(timeout_seconds, alarm - self._central.now())
            if timeout_seconds > 0 and not self._may_continue(alarm):
                self.due = alarm if self._central.is_stepped else math.inf
                self._pause()
                self._continues.wait_for(lambda: self._may_continue(alarm), timeout_seconds)
                self._resume()
            while self._has_packets():
                _, packet = self.packets.popleft()
                if packet:
                    return packet
        return None

    def _may_continue(self, alarm: float) -> bool:
        """Whether the thread has something to do, and may do it. The caller holds the lock."""
        is_due = bool(self.packets) or alarm <= self._central.now()
        return is_due and self._central.may_receive(self)

    def _has_packets(self) -> bool:
        return bool(self.packets) and self._central.may_receive(self)

    def _pause(self) -> None:
        self.is_paused, self.has_turn = True, False
        self._central.schedule()

    def _resume(self) -> None:
        if self.is_paused:
            self.is_paused, self._since = False, time.monotonic()

    def time(self) -> float:
        """Return the time of the handlers' clock, in seconds: that of the local central."""
        return self._central.now()

    def seconds_until(self, moment: float) -> float:
        """Return the real seconds until a time of the handlers' clock.

        On a stepped clock they are infinite, unless the clock has reached that time.
        """
        seconds = moment - self._central.now()
        if not self._central.is_stepped:
            return seconds
        with self._lock:
            if seconds <= 0 and self._central.may_receive(self):
                return seconds
            self.due = min(self.due, moment)
        return math.inf

    @contextmanager
    def pausing(self) -> Iterator[None]:
        """Return a block in which the thread waits for files, among them this connection's."""
        with self._lock:
            self._pause()
        try:
            yield
        finally:
            with self._lock:
                self._resume()

    def has_arrived(self) -> bool:
        """Whether there is a packet to receive, or ``wake`` was called since the last call."""
        is_woken = self._waker.clear()
        with self._lock:
            return is_woken or self._has_packets()

    def files(self) -> Collection[int]:
        """Return the files that become readable when a packet arrives, or ``wake`` is called."""
        return (self._waker.fileno(),)

    def waker(self) -> Waker:
        """Return the object with which other threads end waits."""
        return self._waker

    def wake(self) -> None:
        """End the present wait in ``receive``."""
        with self._lock:
            self.arrive(b"")
            self._central.schedule()

    def close(self) -> None:
        """Close the connection. Central notices that, also without a goodbye."""
        self._central.disconnect(self.id)
        self._waker.close()


_ARRIVALS = itertools.count()
