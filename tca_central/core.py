"""Central's core: the one function that changes central's state.

The core uses no socket, file or thread, and it never reads the time: each event brings its time.

Theory of operation. ``handle`` accepts one event. First it handles each timer that is due at the
event's time. Then it applies the event: a request is carried out by the function in its row of
HANDLERS. Then the core works until nothing changes: points are reached, startable tasks are given
to resources, ended tasks are reported. ``handle`` returns effects for the server to carry out:
first a journal entry with the facts and their cause, then the messages to send. Each timer has an
entry of its own. The same events always give the same effects.

The registry has the modules and messages, and the task tree has the structure of tasks. The agenda
decides about points and constraints, the dispatcher about slots and queues. Agenda and dispatcher
do not know each other. state.py combines these parts. The functions in HANDLERS say what each
request changes in the parts. This file decides when the changes happen.
"""

from collections import deque
from collections.abc import Callable, Sized
from functools import partial
from itertools import compress
from operator import attrgetter
from typing import Never, TypeVar, cast

import msgspec

from tca_central.access import requests as access
from tca_central.control import keeping, monitors, revoking, steering
from tca_central.deadlock import deadlocks
from tca_central.errors import RequestError
from tca_central.events import (
    AdminEvent,
    BadBytes,
    ConnectionId,
    ConnectionLost,
    Effect,
    Event,
    Record,
    RequestReceived,
    Tick,
    Transmit,
)
from tca_central.failing import attaching, failures, policies
from tca_central.life_cycles import busy, changes, observing
from tca_central.locks import claims
from tca_central.model.clock import Timer
from tca_central.model.deliveries import Connection, Delivery, Module, ModuleClaim, Wiretap
from tca_central.model.stored import Stored
from tca_central.model.tasks import Policy, Recovery, Task, TaskOutcome, Watch
from tca_central.outgoing import availability
from tca_central.requests import (
    joining,
    naming,
    replying,
    restarting,
    sending,
    variables,
    waiting,
)
from tca_central.requests.administering import ADMIN_HANDLERS
from tca_central.state import State, TaskWait
from tca_central.status import topics
from tca_central.watching import taps, watches
from tca_wire.journal import causes, facts
from tca_wire.packets import headers, large
from tca_wire.packets.changes import ChangeState, Observe
from tca_wire.packets.headers import Accepted, Refused, ToCentral
from tca_wire.text.printable import shortened
from tca_wire.vocabulary import Due, Limit, Refusal, Role

T = TypeVar("T")

_LONGEST_BODY, _MARK = int(Limit.BODY), large.MARK


class Central(State):
    """Central's whole state. The server changes the state only through ``handle``."""

    __slots__ = ("_output_queues", "_outputs")

    def __init__(self, epoch: str = "test") -> None:
        super().__init__(epoch)
        self.connect_outputs()

    def connect_outputs(self) -> None:
        """Connect each output queue of the agenda and the dispatcher with the queue's function.

        These pairs are not part of the state. They are rebuilt after an image of the state is read.
        """
        agenda = self.agenda
        # The order matters: all items of one queue are handled before those of the next.
        self._outputs: tuple[tuple[Sized, Callable[[], None]], ...] = (
            _output(agenda.taps_to_fire, self._fire_before),
            _output(agenda.tap_events, lambda event: taps.fire_after(self, *event)),
            _output(agenda.resumed_monitors, partial(monitors.proceed, self)),
            _output(agenda.only_background_left, partial(monitors.end_background_monitors, self)),
            _output(agenda.withdrawn, self._withdraw),
            _output(agenda.ended, self._on_ended),
            _output(agenda.with_undecided_requests, partial(changes.apply_defaults, self)),
            _output(agenda.ended_waits, self._end_wait),
            _output(self.dispatcher.granted, partial(claims.on_granted, self)),
            _output(self.dispatcher.waiting_for_busy_handler, partial(busy.on_handler_busy, self)),
            _output(
                self.dispatcher.displaced,
                lambda displaced: replying.report_displaced(self, *displaced),
            ),
            _output(self.dispatcher.stranded, partial(failures.skip_exception_handler, self)),
        )
        self._output_queues = tuple(waiting for waiting, _ in self._outputs)

    def handle(self, event: Event) -> list[Effect]:
        """Handle one event and return its effects, in the order in which they must happen.

        Args:
            event: What has happened. Its time must not be before the last event's time.

        Returns:
            The effects of each timer that was due, then those of the event. Each time a ``Record``
            of the journal entry comes first, then a ``Transmit`` for each message.

        Any exception that leaves this function is a bug in central.
        """
        clock = self.clock
        effects: list[Effect] = []
        if event.time > clock.now:  # noqa: PLR1730 - max() costs as much as four calls
            clock.now = event.time
        while (timer := clock.pop_due()) is not None:
            self._fire_timer(timer, event.time, effects)
        if isinstance(event, RequestReceived):
            self._receive(event, effects)
        elif isinstance(event, BadBytes | ConnectionLost):
            self._on_connection_event(event, effects)
        elif not isinstance(event, Tick):
            self._on_admin_event(event, effects)
        return effects

    # --- an event ---------------------------------------------------------------------------------

    def _fire_timer(self, timer: Timer, time: float, effects: list[Effect]) -> None:
        """Handle a timer that is due."""
        self.event_count += 1
        due, subject = timer.due, timer.subject
        # The entry names the task, message or claim that the timer concerns.
        about = cast("Delivery | ModuleClaim | None", getattr(subject, "task", subject))
        TIMERS[due](self, cast("Never", subject))
        self._process_all()
        self._report(effects, time, causes.TimeOver(due, about.id if about is not None else 0))

    def _on_connection_event(self, event: BadBytes | ConnectionLost, effects: list[Effect]) -> None:
        """Handle a lost connection, or bytes from a connection that cannot be read."""
        self.event_count += 1
        cause: causes.Cause
        connection = self.registry.connections.get(event.connection)
        if isinstance(event, BadBytes):
            cause = causes.Request(*_as_cause(connection), 0, "")
            self._refuse(event.connection, 0, Refusal.PROTOCOL, event.why)
        elif connection is not None:
            cause = causes.ConnectionLost(*_as_cause(connection))
            joining.disconnect(self, connection, event.why, lost=True)
        else:
            return
        self._process_all()
        self._report(effects, event.time, cause)

    def _on_admin_event(self, event: AdminEvent, effects: list[Effect]) -> None:
        """Handle an event of the operator, or an event that central itself raises."""
        self.event_count += 1
        ADMIN_HANDLERS[type(event)](self, cast("Never", event))
        self._process_all()
        self._report(effects, event.time, causes.Administrator())

    def _receive(self, event: RequestReceived, effects: list[Effect]) -> None:
        """Handle a request. A request that cannot be done is refused and changes nothing."""
        self.event_count += 1
        header = event.header
        kind = KINDS[type(header)]
        number: int = header.number if kind.has_number else 0  # type: ignore[union-attr]
        connection = self.registry.connections.get(event.connection)
        try:
            if connection is None:
                connection = self._admit_stranger(event, number)
            elif event.principal != connection.principal:
                connection = self._replace_stale_connection(connection, event, number)
            elif (
                number
                and number <= connection.last_number
                and (type(header) not in _NOT_STORED or number in connection.outstanding)
            ):
                self._repeat(connection, number)
            else:
                if number > connection.last_number:  # noqa: PLR1730 - max() is slow, as above
                    connection.last_number = number
                self._carry_out(connection, header, event.body, kind)
        except RequestError as error:
            if isinstance(header, headers.Send) and header.quiet and self.origin:
                sending.record_refusal(self, header, error.text)
            self._refuse(event.connection, number, error.refusal, error.text)
        self._process_all()
        cause = causes.Request(*_as_cause(connection), number, kind.name, self.origin)
        self._report(effects, event.time, cause)
        self.origin = 0

    def _carry_out(
        self, connection: Connection, header: ToCentral, body: bytes, kind: "_Kind"
    ) -> None:
        """Check a request, and call the function in its row of HANDLERS."""
        if kind.needs_number and not header.number:  # type: ignore[union-attr]
            raise RequestError(
                Refusal.PROTOCOL, f"{kind.name} waits for an answer, so it needs a request number"
            )
        if kind.read_origin is not None and (origin := kind.read_origin(header)):
            self.origin = self._checked_origin(origin, connection)
            if kind.drops_wrong_origin and not self.origin and origin in self.dispatcher.running:
                # Another module handles *origin*: the request counts as one without origin.
                header = msgspec.structs.replace(header, origin=0)
            connection.acts_known_until = self.clock.now
        if kind.names_tasks:
            header = naming.with_ids(connection, header)
            if self.lost_ids:
                naming.refuse_lost(self.lost_ids, header)
        if connection.rights is not None:
            access.check(self, connection, header)
        if (len(body) > _LONGEST_BODY or body[:1] == _MARK) and (why := replying.fault_of(body)):
            replying.refuse_body(self, connection, header, why)
        else:
            HANDLERS[type(header)](self, connection, cast("Never", header), body)

    def _checked_origin(self, origin: int, connection: Connection) -> int:
        """Return *origin*, the delivery whose handler sent a request.

        Return 0 if the sender's module does not handle that delivery now.
        """
        asking = self.dispatcher.running.get(origin) or self.dispatcher.begin_prefetched(
            connection, origin
        )
        slot = asking.slot if asking is not None else None
        if asking is None or slot is None or slot.module is not connection.module:
            return 0
        if not asking.has_begun:
            asking.has_begun, slot.handling[asking] = True, self.event_count - 1
        return origin

    def _admit_stranger(self, event: RequestReceived, number: int) -> Connection | None:
        """Handle a request of an unknown connection.

        A ``Hello`` makes the connection known. Return the connection, or None if it stays unknown.
        """
        if isinstance(event.header, headers.Hello):
            joining.greet(self, event.connection, event.header, event.principal)
        else:
            self.messages.append(Transmit(event.connection, headers.Unknown(number)))
        return self.registry.connections.get(event.connection)

    def _replace_stale_connection(
        self, stale: Connection, event: RequestReceived, number: int
    ) -> Connection | None:
        """Replace a stale connection: another user's connection now has its id.

        The stale connection has broken, and central had not noticed.
        """
        joining.disconnect(self, stale, "a connection of another user has its name", lost=True)
        return self._admit_stranger(event, number)

    def _report(self, effects: list[Effect], time: float, cause: causes.Cause | None) -> None:
        """Add the journal entry and the messages of the present event to *effects*."""
        if self.facts:
            if self.blocked or self.claims:
                deadlocks.check_event(self)
            entry = facts.Entry(self.event_count, time, self.facts[:], cause)
            self.facts.clear()
            effects.append(Record(entry, self.failed) if self.failed else Record(entry))
            if self.failed:
                self.failed = {}
        effects += self.messages
        self.messages.clear()

    def _refuse(
        self, connection_id: ConnectionId, number: int, refusal: Refusal, text: str
    ) -> None:
        """Refuse a request of a connection that may be unknown."""
        connection = self.registry.connections.get(connection_id)
        if connection is not None:
            self.refuse(connection, number, refusal, text)
        else:
            text = shortened(text)
            self.facts.append(facts.RequestRefused("?", refusal, text))
            self.messages.append(Transmit(connection_id, Refused(number, refusal, text)))

    def _repeat(self, connection: Connection, number: int) -> None:
        """Answer a repeated request as before, or confirm that the request is in progress.

        If central no longer knows the request, refuse it.
        """
        header, body = self.answers.get(connection, number)
        if header is None:
            pending = connection.outstanding.get(number)
            sent_task = connection.tasks.get(number, 0)
            header = Accepted(number, sent_task or getattr(pending, "id", 0))
            if pending is None and not sent_task:
                text = (
                    f"request {number} is not open: it was answered long ago, or dropped when the "
                    "connection broke"
                )
                header = Refused(number, Refusal.TOO_LATE, text)
        self.messages.append(Transmit(connection.id, header, body))

    # --- until nothing changes --------------------------------------------------------------------

    def _process_all(self) -> None:
        """Work until nothing changes.

        The branches are in order of precedence. For example, the queues of results are emptied
        before more tasks are started.
        """
        agenda, dispatcher = self.agenda, self.dispatcher
        while True:
            if agenda.to_advance:
                self._advance_all()
            if any(self._output_queues):
                self._handle_outputs()
            elif dispatcher.old_serving_counts:
                availability.publish_changes(self)
            elif agenda.startable:
                self._start_all()
            elif dispatcher.lending.to_lend:
                waiting.lend(self, dispatcher.lending.to_lend.popleft())
            elif dispatcher.to_refill:
                dispatcher.refill_next()
            elif self.suspects:
                deadlocks.check_suspects(self)
            else:
                return

    def _advance_all(self) -> None:
        """Advance tasks. Claims end with their tasks, before the ends send or release anything."""
        self.agenda.advance_all()
        for task in self.agenda.ended if self.claimed_for else ():
            claims.end_claims_of(self, task, "it has ended")

    def _handle_outputs(self) -> None:
        """Handle all items of the queues that are not empty."""
        # ``compress`` tests each queue when the queue's turn comes. An earlier function may have
        # filled a later queue.
        for _, handle_all in compress(self._outputs, self._output_queues):
            handle_all()

    def _end_wait(self, ended: tuple[Task, Stored]) -> None:
        """End a wait: its moment was reached."""
        task, wait = ended
        REACHED[type(wait)](self, cast("Never", wait), task)

    def _withdraw(self, withdrawn: tuple[Task, bool]) -> None:
        """Remove a task from its queues.

        A suspended or retried task keeps its place in line for its next start.
        """
        task, was_suspended = withdrawn  # the task may have been resumed since
        self.dispatcher.withdraw(
            task, keep_place=was_suspended or task.suspended or task.retry_pending
        )

    def _fire_before(self, tapped: tuple[Task, list[Wiretap]]) -> None:
        """Fire the wiretaps before some moments of a task.

        Then the task reaches those of the moments that no listener holds.
        """
        taps.fire_before(self, *tapped)
        self._advance_all()

    def _start_all(self) -> None:
        """Start the startable tasks of the most urgent kind.

        Exception handlers that no module handles come first. Central skips them, which may end
        other tasks. Monitors come next, and all other tasks last.
        """
        waiting = self.agenda.startable
        # A task is listed twice if it was retried after its start was granted.
        startable = [
            task for task in dict.fromkeys(waiting) if task.start_granted and not task.killed
        ]
        waiting.clear()
        urgent = startable if len(startable) < 2 else _most_urgent(startable)
        if len(urgent) < len(startable):
            in_turn = set(urgent)
            waiting.extend(task for task in startable if task not in in_turn)
        if urgent and urgent[0].message.message_class.is_monitor:
            for task in urgent:
                if not task.killed:  # a monitor that fails at once may end the next
                    if task.retry_pending:
                        self._start_attempt(task)
                    monitors.start(self, task)
            return
        replaced = {task for task in urgent if task.retry_pending and self._start_attempt(task)}
        self.dispatcher.route_all(
            [task for task in urgent if not (task.killed or task in replaced)]
        )

    def _start_attempt(self, task: Task) -> bool:
        """Start the next attempt of a retried task, unless a client's request ends the task.

        Return whether the fallback of its retry policy replaces the attempt.
        """
        changes.restart(self, task, is_replaced=Policy.is_replaced(task))
        if task.killed:
            return False
        task.retry_pending = False
        if policies.send_fallback(self, task):
            claims.end_claims_of(self, task, "it is replaced")
            return True
        task.handling_id = self.new_id()
        recovery = Recovery.of(task)
        recovery.attempts += 1
        recovery.exception_handler = None
        claims.end_claims_of(self, task, "it is retried")
        return False

    def _on_ended(self, task: Task) -> None:
        """Clean up after a task that has ended, and report its end."""
        if self.observers.may_observe(task) or task.message.life_cycle.has_many_ends:
            observing.publish_end(self, task)
        if task.scheduled is not None:
            steering.forget_pending(self, task.scheduled)
        if task.recovery is not None:
            attaching.forget_task(self, task)
            policies.end_attempt(self, task)
        if task.tapping is not None:
            taps.forget_task(self, task)
        if task.retention is not None:
            keeping.retain_or_drop(self, task, task.retention)
        if task.role is Role.EXCEPTION:
            failures.on_exception_handler_ended(self, task)
        if task.result or task.killed or task.failure is not None or task.end_state:
            self._remember_outcome(task, self.outcome(task))

    def _remember_outcome(self, task: Task, outcome: TaskOutcome) -> None:
        """Store the outcome of a task, unless it is done without a result and in the usual way."""
        owners = self.registry.permissions.outcome_owners
        if self.registry.permissions.rules is not None and isinstance(task.sent_by, Module):
            owners[task.id] = task.sent_by.principal
        end, most_bytes = task.end_state, self.budget.outcomes
        for forgotten in self.memory.remember(task.id, outcome, end, most_bytes):
            owners.pop(forgotten, None)
            self.tree.never_began.pop(forgotten, None)


def _output(waiting: deque[T], handle: Callable[[T], None]) -> tuple[Sized, Callable[[], None]]:
    """Return a queue, and a function that removes each item from the queue and handles it."""

    def handle_all() -> None:
        while waiting:
            handle(waiting.popleft())

    return waiting, handle_all


def _as_cause(connection: Connection | None) -> tuple[str, int]:
    """Return a connection's module and number, the form in which causes name a connection."""
    return ("?", 0) if connection is None else (connection.module.name, connection.number)


def _most_urgent(startable: list[Task]) -> list[Task]:
    """Return the tasks to start first: stranded exception handlers, else monitors, else all."""
    if stranded := [task for task in startable if task.is_stranded]:
        return stranded
    return [task for task in startable if task.message.message_class.is_monitor] or startable


HANDLERS: dict[type, Callable[[Central, Connection, Never, bytes], None]] = {
    headers.Hello: joining.on_hello_again,
    headers.Register: joining.on_register,
    headers.Unregister: joining.on_unregister,
    headers.Send: sending.on_send,
    headers.Reply: replying.on_reply,
    headers.Replies: replying.on_replies,
    headers.Fail: replying.on_fail,
    headers.Postpone: replying.on_postpone,
    headers.Constrain: sending.on_constrain,
    headers.AwaitPoint: waiting.on_await_point,
    headers.Await: waiting.on_await,
    headers.GiveUp: waiting.on_give_up,
    headers.Release: waiting.on_release,
    headers.Kill: steering.on_kill,
    headers.Ask: topics.on_ask,
    headers.Attach: attaching.on_attach,
    headers.Remove: attaching.on_remove,
    headers.Raise: failures.on_raise,
    headers.Retry: failures.on_retry,
    headers.Resolve: failures.on_resolve,
    headers.Suspend: steering.on_suspend,
    headers.Deadline: steering.on_deadline,
    headers.Inspect: topics.on_inspect,
    ChangeState: changes.on_change_state,
    Observe: observing.on_observe,
    headers.Tap: taps.on_tap,
    headers.Fire: monitors.on_fire,
    headers.EndMonitor: monitors.on_end_monitor,
    headers.Keep: keeping.on_keep,
    headers.Recalled: joining.on_recalled,
    headers.Bye: joining.on_bye,
    headers.Receipt: joining.on_receipt,
    headers.UsesStore: lambda *_: None,  # the server handles it
    headers.GetVariable: variables.on_get_variable,
    headers.SetVariable: variables.on_set_variable,
    headers.WaitUntilHandled: availability.on_wait_until_handled,
    headers.Lock: claims.on_lock,
    headers.AwaitAny: waiting.on_await_any,
    headers.Unlock: revoking.on_unlock,
    headers.GoOn: restarting.on_go_on,
    headers.EndCentral: joining.on_end_central,
}
"""One row per class of request: the function to call when such a request arrives.

Each function takes headers of the class of its row only.
"""


_NEED_NUMBER = (
    headers.AwaitPoint,
    headers.GetVariable,
    headers.Lock,
    headers.WaitUntilHandled,
    Observe,
)
"""Requests that are refused without a number: nothing but a later answer comes of them."""


class _Kind:
    """The core's knowledge of one class of request."""

    __slots__ = (
        "drops_wrong_origin",
        "has_number",
        "name",
        "names_tasks",
        "needs_number",
        "read_origin",
    )

    def __init__(self, header: type[msgspec.Struct]) -> None:
        fields = header.__struct_fields__
        field = next((name for name in ("origin", "delivery") if name in fields), "")
        self.name: str = header.__name__
        self.has_number = "number" in fields
        self.needs_number = header in _NEED_NUMBER
        # A ``Lock`` keeps a wrong origin, and its handler refuses it. A lock ends with the delivery
        # that ``origin`` names.
        self.drops_wrong_origin = "origin" in fields and header is not headers.Lock
        self.names_tasks = bool(naming.NAMING[header])
        self.read_origin: Callable[[ToCentral], int] | None = attrgetter(field) if field else None
        """The function that reads the request's origin: the delivery whose handler sent it.

        It is None for headers that have no such field.
        """


KINDS = {header: _Kind(header) for header in HANDLERS}

_NOT_STORED = (headers.Hello, headers.GetVariable)
"""Requests without stored answers: a repeated one is done again, unless its number is open."""


REACHED: dict[type, Callable[[Central, Never, Task], None]] = {
    TaskWait: lambda central, wait, task: wait.answer(central, central.outcome(task)),
    steering.PendingKill: lambda central, pending, _: pending.proceed(central),
    Watch: watches.on_end_point,
}
"""One row per kind of wait for a task's moment: the function to call when it is reached."""


TIMERS: dict[Due, Callable[[Central, Never], None]] = {
    Due.RELEASE: lambda central, delay: central.agenda.end_delay(delay),
    Due.DEADLINE: steering.on_time_out,
    Due.ATTEMPT: steering.on_attempt_time_out,
    Due.KILL: lambda central, ending: ending.carry_out(central),
    Due.TEST: monitors.on_test,
    Due.MONITOR_OVER: monitors.on_duration_over,
    Due.HUNG: joining.on_hung,
    Due.CLAIM: claims.on_time_out,
    Due.LOOK: deadlocks.on_search_due,
    Due.GRACE: joining.on_grace_over,
}
"""One row per kind of timer: the function to call when such a timer is due."""
