"""Central's core: the one function by which its state changes. Knows no socket, file, clock or thread.

Theory of operation. ``handle`` takes one event, lets the row of HANDLERS for it record what happened, then settles:
points are reached, startable tasks are given to resources, ended tasks are reported, until nothing moves. It returns
what the world must do: first the journal entry with every fact and its cause, then the messages to send. Each timer
that is due by then comes before the event, as an entry of its own. The same events always give the same effects.

The rules live apart and do not know each other: registry (who and what), task_tree (structure), agenda (points and
constraints), resources and dispatcher (capacity and order); state.py puts them together, the files in requests/ say
what each message means to them, and this file decides when.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from operator import attrgetter
from typing import Any

import msgspec

from tca_central.control import keeping, monitors
from tca_central.control import kills_and_suspension as control
from tca_central.control import revoking as taking
from tca_central.deadlock import resolve as deadlocks
from tca_central.errors import RequestError
from tca_central.events import BadBytes, Effect, Event, Received, Record, Tick, Transmit
from tca_central.failing import attaching, failures
from tca_central.locks import claims
from tca_central.model.clock import Timer
from tca_central.model.registry import Connection
from tca_central.model.resources import Claim
from tca_central.model.task_tree import Task
from tca_central.outgoing import availability
from tca_central.outgoing import direct_routes as direct
from tca_central.requests import giving_up, joining
from tca_central.requests import sending as requests
from tca_central.requests import variables as sharing
from tca_central.requests import waiting as waits
from tca_central.state import State
from tca_central.watching import taps
from tca_wire.journal import causes, facts
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted, Refused
from tca_wire.packets.routes import Noted, WatchEntrance
from tca_wire.vocabulary import Due, Outcome, Refusal, Role

REMEMBERED_OUTCOMES = 10_000
REMEMBERED_BYTES = 64 << 20
"""Ended tasks whose failure or result can still be asked for, and how much these may hold."""


class Central(State):
    """The state of everything. ``handle`` is the only way it changes; all else that is public are questions."""

    def __init__(self, epoch: str = "test") -> None:
        super().__init__(epoch)
        agenda = self.agenda
        # What comes out of the agenda, and who takes it; in this order, and all of one kind before the next.
        self._takers: tuple[tuple[deque[Any], Callable[[Any], None]], ...] = (
            (agenda.tapped, lambda tapped: taps.fire_before(self, *tapped)),
            (agenda.happened, lambda happened: taps.happened(self, *happened)),
            (agenda.alone, partial(monitors.end_watchers, self)),
            (agenda.withdrawn, self._withdraw),
            (agenda.ended, self._ended),
            (agenda.met, self._met),
            (self.dispatcher.granted, partial(claims.granted, self)),
            (self.dispatcher.displaced, lambda displaced: requests.displace(self, *displaced)),
            (self.dispatcher.stranded, partial(failures.pass_over, self)),
        )
        self._come_out = tuple(waiting for waiting, _ in self._takers)

    def handle(self, event: Event) -> list[Effect]:
        """Let *event* happen; what must be done about it, in that order. Any exception is a bug in central."""
        self.clock.now = max(self.clock.now, event.time)
        effects: list[Effect] = []
        while (timer := self.clock.take()) is not None:
            self.events += 1
            TIMERS[timer.due](self, timer.subject)
            effects += self._settled(event.time, causes.TimeOver, timer.due, _subject_of(timer))
        if isinstance(event, Tick):
            return effects
        self.events += 1
        connection = self.registry.connections.get(event.connection)
        if isinstance(event, Received):
            header = event.header
            self.origin = self._origin(connection, header)
            self._on_message(event, connection)
            connection = connection or self.registry.connections.get(event.connection)
            told = getattr(header, "number", 0), type(header).__name__, self.origin
            effects += self._settled(event.time, causes.Request, *_named(connection), *told)
            self.origin = 0
        elif isinstance(event, BadBytes):
            self._refuse(event.connection, 0, Refusal.PROTOCOL, event.why)
            effects += self._settled(event.time, causes.Request, *_named(connection), 0, "")
        elif connection is not None:
            joining.leave(self, connection, event.why, lost=True)
            effects += self._settled(event.time, causes.ConnectionLost, *_named(connection))
        return effects

    # --- an event ----------------------------------------------------------------------------------------------

    def _settled(self, time: float, kind: Callable[..., causes.Cause], *cause: Any) -> list[Effect]:
        """Let all that follows happen, too; what is to be done about it and its cause."""
        self._settle()
        if self.facts and (self.blocked or self.claims):
            deadlocks.has_happened(self)
        effects, self.messages = self.messages, []
        if self.facts:
            entry = facts.Entry(self.events, time, self.facts[:], kind(*cause))
            effects = [Record(entry, self.failed), *effects]
            self.facts.clear()
            if self.failed:
                self.failed = {}
        return effects

    def _origin(self, connection: Connection | None, header: Any) -> int:
        """The delivery whose handler sends this, if the module has it."""
        read = ORIGINS[type(header)]
        origin: int = read(header) if read is not None else 0
        asking = self.dispatcher.attended.get(origin) if origin else None
        if asking is None or asking.slot is None or connection is None:
            return 0
        return origin if asking.slot.module is connection.module else 0

    def _on_message(self, event: Received, connection: Connection | None) -> None:
        header = event.header
        number = getattr(header, "number", 0)
        if connection is None:
            if isinstance(header, headers.Hello):
                self._guarded(event.connection, header.number, lambda: joining.hello(self, event.connection, header))
            else:
                self.messages.append(Transmit(event.connection, headers.Unknown(number)))
            return
        if number and number <= connection.last_number and not isinstance(header, headers.Hello):
            self._repeat(connection, number)
            return
        connection.last_number = max(connection.last_number, number)
        handler = HANDLERS[type(header)]
        self._guarded(connection.id, number, lambda: handler(self, connection, header, event.body))

    def _guarded(self, connection_id: Any, number: int, do: Callable[[], None]) -> None:
        """A request that can't be done is refused and leaves nothing behind."""
        try:
            do()
        except RequestError as error:
            self._refuse(connection_id, number, error.refusal, error.text)

    def _refuse(self, connection_id: Any, number: int, refusal: Refusal, text: str) -> None:
        connection = self.registry.connections.get(connection_id)
        self.facts.append(facts.RequestRefused(connection.module.name if connection else "?", refusal, text))
        if connection and number:
            connection.outstanding.pop(number, None)
            self.send(connection, number, Refused(number, refusal, text))
        else:
            self.messages.append(Transmit(connection_id, Refused(number, refusal, text)))

    def _repeat(self, connection: Connection, number: int) -> None:
        """A request came twice: give the answer that it had, or say again that it was taken."""
        header, body = connection.answers.get(number, (None, b""))
        if header is None:
            known = connection.outstanding.get(number)
            header = Accepted(number, getattr(known, "id", 0))
            if known is None:
                text = f"request {number} is not open: it was answered long ago, or dropped when the connection broke"
                header = Refused(number, Refusal.TOO_LATE, text)
        self.messages.append(Transmit(connection.id, header, body))

    # --- what the rules agree on -----------------------------------------------------------------------------------

    def _settle(self) -> None:
        """Let everything happen that may, until nothing moves."""
        agenda, dispatcher = self.agenda, self.dispatcher
        agenda.settle()
        while True:
            if any(self._come_out):
                for waiting, take in self._takers:
                    while waiting:
                        take(waiting.popleft())
            elif dispatcher.changed:
                availability.tell_changes(self)
            elif agenda.startable:
                self._start_all()
            elif dispatcher.freed:
                dispatcher.give_freed_slot()
            elif self.suspects:
                deadlocks.look(self)
            else:
                return
            agenda.settle()

    def _withdraw(self, task: Task) -> None:
        self.dispatcher.withdraw(task, keep_place=task.suspended or task.again)

    def _met(self, met: tuple[Task, Any]) -> None:
        task, waiter = met
        waiter.met(self, task)

    def _start_all(self) -> None:
        """Everything has settled but these tasks, which may start. First come exception handlers that nobody handles,
        which ends others, then monitors, which take no slot from anyone; each with all that follows from that.
        """
        waiting = self.agenda.startable
        startable = [task for task in waiting if task.requested and not task.killed]
        waiting.clear()
        first = startable if len(startable) < 2 else _first_of(startable)
        if len(first) < len(startable):
            is_first = set(first)
            waiting.extend(task for task in startable if task not in is_first)
        if first and first[0].message.message_class.is_monitor:
            for task in first:
                if not task.killed:  # one that fails at once may end others
                    self._count_attempt(task)
                    monitors.start(self, task)
            return
        for task in first:
            self._count_attempt(task)
        self.dispatcher.route_all(first)

    def _count_attempt(self, task: Task) -> None:
        if task.again:
            task.again = False
            task.given_as = self.new_id()
            task.more.attempts += 1
            task.more.recovering = None
            claims.end_with(self, task, "it is retried")

    def _ended(self, task: Task) -> None:
        if self.claimed_for:
            claims.end_with(self, task, "it has ended")
        if task.rare is not None:
            control.forget_pending(self, task)
            attaching.forget_task(self, task)
            taps.forget_task(self, task)
            keeping.ended(self, task)
        if task.role is Role.EXCEPTION:
            failures.handler_ended(self, task)
        outcome = self.outcome(task)
        if outcome[0] is not Outcome.DONE or outcome[3]:
            self.outcomes[task.id] = outcome
            self.outcome_bytes += _size(outcome)
            while len(self.outcomes) > REMEMBERED_OUTCOMES or self.outcome_bytes > REMEMBERED_BYTES:
                oldest = next(iter(self.outcomes))
                self.outcome_bytes -= _size(self.outcomes.pop(oldest))
                self.forgotten = max(self.forgotten, oldest)


def _named(connection: Connection | None) -> tuple[str, int]:
    """A connection as causes name it."""
    return ("?", 0) if connection is None else (connection.module.name, connection.number)


def _subject_of(timer: Timer) -> int:
    """The task, or the claim, that a timer is about."""
    subject: Any = timer.subject
    if subject is None:
        return 0
    return int(subject.id if isinstance(subject, Claim) else subject.task.id)


def _origin_reader(kind: type[msgspec.Struct]) -> Callable[[Any], int] | None:
    """What reads, from a message of a kind, the delivery whose handler sends it; None if it does not say."""
    name = next((name for name in ("origin", "delivery") if name in kind.__struct_fields__), "")
    return attrgetter(name) if name else None


def _first_of(startable: list[Task]) -> list[Task]:
    """Those of several startable tasks that go before all others: all of one kind."""
    stranded = [task for task in startable if task.is_stranded]
    return stranded or [task for task in startable if task.message.message_class.is_monitor] or startable


def _size(outcome: tuple[Outcome, str, str, bytes]) -> int:
    return len(outcome[2]) + len(outcome[3])


HANDLERS: dict[type, Callable[[Central, Connection, Any, bytes], None]] = {
    headers.Hello: joining.on_hello_again,
    headers.Register: joining.on_register,
    headers.Unregister: joining.on_unregister,
    headers.Send: requests.on_send,
    headers.Reply: requests.on_reply,
    headers.Fail: requests.on_fail,
    headers.Constrain: requests.on_constrain,
    headers.WaitFor: waits.on_wait_for,
    headers.Await: giving_up.on_await,
    headers.GiveUp: giving_up.on_give_up,
    headers.Release: giving_up.on_release,
    headers.Kill: control.on_kill,
    headers.Ask: requests.on_ask,
    headers.Attach: attaching.on_attach,
    headers.Remove: attaching.on_remove,
    headers.Raise: failures.on_raise,
    headers.Retry: failures.on_retry,
    headers.Suspend: control.on_suspend,
    headers.Deadline: control.on_deadline,
    headers.Inspect: requests.on_inspect,
    headers.Tap: taps.on_tap,
    headers.Fire: monitors.on_fire,
    headers.EndMonitor: monitors.on_end_monitor,
    headers.Keep: keeping.on_keep,
    headers.Bye: joining.on_bye,
    headers.GetVariable: sharing.on_get_variable,
    headers.SetVariable: sharing.on_set_variable,
    headers.WaitUntilHandled: availability.on_wait_until_handled,
    headers.Lock: claims.on_lock,
    headers.AwaitAny: waits.on_await_any,
    headers.Unlock: taking.on_unlock,
    Noted: direct.on_noted,
    WatchEntrance: direct.on_watch_entrance,
}
"""One row per message: what happens when it arrives."""

ORIGINS = {kind: _origin_reader(kind) for kind in HANDLERS}
"""For each message what reads, from one, the delivery whose handler sends it."""


TIMERS: dict[Due, Callable[[Central, Any], None]] = {
    Due.RELEASE: lambda central, release: central.agenda.released(release),
    Due.DEADLINE: control.on_time_out,
    Due.KILL: lambda central, ending: ending.now(central),
    Due.TEST: monitors.on_test,
    Due.WATCHED: monitors.on_watched,
    Due.CLAIM: claims.on_time_out,
    Due.LOOK: deadlocks.on_look,
}
"""One row per kind of timer: what happens when it is due."""
