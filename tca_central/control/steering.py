"""Steers existing tasks: kills, deadlines, suspension, and messages sent on termination.

Kills happen at once, later, or after a point. Pending kills and deadlines are limited in number,
and forgotten when the task ends.
"""

import msgspec

from tca_central.errors import RequestError
from tca_central.failing.failures import kill, raise_failure
from tca_central.model.budget import DELIVERY_BYTES, TIMER_BYTES, WAIT_BYTES
from tca_central.model.clock import checked_seconds
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import Connection, MessageType
from tca_central.model.intervals import checked_moment
from tca_central.model.stored import Stored
from tca_central.model.tasks import Policy, Recovery, Scheduled, Task, Verdict
from tca_central.outgoing.central_messages import make_task, suspend
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.messages.failures import TIMEOUT
from tca_wire.packets import headers
from tca_wire.packets.large import held_size
from tca_wire.points import END_ACHIEVING, ROOT, THIS, Point, describe_moments
from tca_wire.text.printable import shortened
from tca_wire.vocabulary import Due, Refusal, Role, Scope

MOST_PENDING = 1000
"""Kills, deadlines and delays that may be pending for one task."""

LONGEST_PLANNED = 200
"""Characters of a planned kill's reason. Few, because the budget does not count them."""

MOST_TERMINATION_MESSAGES = 100
"""Messages to send on the termination of one task."""


def _check_pending(central: State, task: Task) -> None:
    """Raise RequestError if no more kills, deadlines and delays may be pending for a task."""
    central.check_declared(TIMER_BYTES + WAIT_BYTES)
    if task.scheduled is not None and len(task.scheduled.pending) >= MOST_PENDING:
        raise RequestError(
            Refusal.OVERLOAD,
            f"{MOST_PENDING:,} kills, deadlines and delays are pending for {task} already",
        )


def forget_pending(central: State, scheduled: Scheduled) -> None:
    """Cancel all kills, deadlines and delays that are pending for a task that has ended."""
    for pending, awaited in scheduled.pending.items():
        if isinstance(awaited, Task):
            central.agenda.stop_waiting(awaited, pending)
        else:
            central.clock.cancel(awaited)
    scheduled.pending.clear()


# --- kills ----------------------------------------------------------------------------------------


class PendingKill(Stored):
    """A kill to carry out when a point is reached, or a delay after that."""

    __slots__ = ("delay", "scope", "task", "verdict")

    def __init__(self, task: Task, scope: Scope, delay: float, verdict: Verdict) -> None:
        self.task, self.scope, self.delay, self.verdict = task, scope, delay, verdict

    def proceed(self, central: State) -> None:
        """Kill at once, or start the delay: the point is reached, or there is none."""
        if not self.delay:
            self.carry_out(central)
        elif self._is_alive(central):
            Scheduled.of(self.task).pending[self] = central.clock.after(self.delay, Due.KILL, self)

    def carry_out(self, central: State) -> None:
        """Kill the tasks in scope."""
        if self.task.scheduled is not None:
            self.task.scheduled.pending.pop(self, None)
        if self._is_alive(central):
            for task in self._targets():
                kill(central, task, self.verdict)

    def _targets(self) -> list[Task]:
        """Return the tasks in scope: the task, its children, or its siblings."""
        if self.scope is Scope.TASK:
            return [self.task]
        parent = self.task if self.scope is Scope.DESCENDANTS else self.task.parent
        assert parent is not None
        return [
            child
            for child in (parent.children or {}).values()
            if child is not self.task and not child.role.survives
        ]

    def _is_alive(self, central: State) -> bool:
        """Whether the task still lives. The event that reached the point may have ended it."""
        return self.task.id == ROOT or self.task.id in central.tree.tasks


def on_kill(central: State, connection: Connection, header: headers.Kill, _: bytes) -> None:
    """Kill a task, its descendants or its siblings for a module: now, later, or after a point."""
    if header.task < THIS:
        header = msgspec.structs.replace(header, task=connection.tasks.get(-header.task, ROOT))
        if not header.task:  # central refused the task, or never got it: requests come in order
            central.accept(connection, header.number)
            return
    checked_seconds(header.delay, f"a kill of task {{{header.task}}} with a delay")
    is_all = header.task == ROOT and header.scope is Scope.DESCENDANTS
    task = central.tree.root if is_all else central.tree.task(header.task)
    if task is None:
        text = f"task {{{header.task}}} has ended: it can't be killed"
        central.ignore(connection, header.number, text)
        return
    is_planned = bool(header.delay or header.after)
    why = shortened(header.why, LONGEST_PLANNED) if is_planned else shortened(header.why)
    verdict = Verdict(why, connection.module.name, central.origin)
    pending = PendingKill(task, header.scope, header.delay, verdict)
    awaited = central.tree.task(header.after.task) if header.after is not None else None
    if (
        header.after is not None
        and awaited is not None
        and not awaited.reached & checked_moment(header.after)
    ):
        _record_plan(central, pending, header.after)
        Scheduled.of(task).pending[pending] = awaited
        central.agenda.add_waiter(awaited, checked_moment(header.after), pending)
    else:
        if header.delay:
            _record_plan(central, pending, None)
        pending.proceed(central)
    central.accept(connection, header.number, header.task)


def _record_plan(central: State, kill: PendingKill, after: Point | None) -> None:
    """Record a kill that happens later, or raise RequestError if too many are pending."""
    _check_pending(central, kill.task)
    task, (why, by, *_) = kill.task.id, kill.verdict
    central.facts.append(facts.KillPlanned(task, kill.scope, after, kill.delay, why, by))


# --- deadlines ------------------------------------------------------------------------------------


class PendingDeadline(Stored):
    """A deadline for a point of a task."""

    __slots__ = ("moment", "seconds", "task")

    def __init__(self, task: Task, moment: int, seconds: float) -> None:
        self.task, self.moment, self.seconds = task, moment, seconds


def set_deadline(central: State, task: Task, moment: int, seconds: float) -> None:
    """Raise the failure "timeout" unless a task reaches *moment* within *seconds* from now."""
    deadline = PendingDeadline(task, moment, seconds)
    Scheduled.of(task).pending[deadline] = central.clock.after(seconds, Due.DEADLINE, deadline)
    central.facts.append(facts.DeadlineSet(task.id, moment, seconds))


def on_time_out(central: State, deadline: PendingDeadline) -> None:
    """Raise the failure "timeout" if a task has missed its deadline."""
    task, moment = deadline.task, deadline.moment
    del Scheduled.of(task).pending[deadline]
    if not (task.killed or task.reached & moment):
        if (policy := Policy.of(task)) is not None:
            policy.allow_no_retry()
        is_end = moment == END_ACHIEVING
        missed = "not achieved" if is_end else f"{describe_moments(moment)[0]} not reached"
        text = f"{missed} within {deadline.seconds:g} s"
        raise_failure(central, task, RaisedFailure(TIMEOUT, text))


def on_attempt_time_out(central: State, policy: Policy) -> None:
    """Raise the failure "timeout" on a task whose attempt takes longer than its policy allows."""
    policy.timer = None
    if not policy.task.killed:
        attempt, seconds = Recovery.of(policy.task).attempts, policy.declared.attempt_timeout
        text = f"attempt {attempt} not done within {seconds:g} s"
        raise_failure(central, policy.task, RaisedFailure(TIMEOUT, text))


def on_deadline(central: State, connection: Connection, header: headers.Deadline, _: bytes) -> None:
    """Set a deadline for a point of a task, as a module requests."""
    checked_seconds(header.seconds, f"a deadline of task {{{header.point.task}}}")
    moment = checked_moment(header.point)
    task = central.living_task_or_ignore(
        connection, header.number, header.point.task, "no deadline can be set"
    )
    if task is None:
        return
    if not task.reached & moment:
        _check_pending(central, task)
        set_deadline(central, task, moment, header.seconds)
    central.accept(connection, header.number, header.point.task)


# --- suspension -----------------------------------------------------------------------------------


def on_suspend(central: State, connection: Connection, header: headers.Suspend, _: bytes) -> None:
    """Suspend or resume a task with all under it, for a module (TCM: Suspend, Unsuspend)."""
    task = central.tree.task(header.task)
    if task is None:
        text = f"task {{{header.task}}} has ended: it can't be suspended or resumed"
        central.ignore(connection, header.number, text)
        return
    suspend(central, task, resume=header.resume, by=connection.module.name)
    central.accept(connection, header.number, task.id)


# --- on termination (TDL: ON TERMINATE) -----------------------------------------------------------


def check_termination_message(message: MessageType, task_id: int) -> None:
    """Raise RequestError if the message can't be sent on the termination of that task."""
    if not (message.message_class.is_task and message.message_class.may_react):
        text = f"{message.title} can't be sent on termination: goals and commands can"
        raise RequestError(Refusal.PROTOCOL, text)
    if task_id == ROOT:
        text = f"'{message.name}' can't be sent on the termination of the root: it never ends"
        raise RequestError(Refusal.PROTOCOL, text)


def store_termination_message(
    central: State, task: Task, message: MessageType, body: bytes
) -> None:
    """Store a message to send when the task is killed.

    If the task was killed and its handler still runs, send the message now.
    """
    if task.killed and task.slot is None:
        text = (
            f"{task} was killed and its handler has returned: "
            f"'{message.name}' is not sent on its termination any more"
        )
        raise RequestError(Refusal.TOO_LATE, text)
    if task.killed:
        make_task(central, message, body, task, Role.TERMINATION)
        return
    termination_messages = Scheduled.of(task).termination_messages
    if len(termination_messages) >= MOST_TERMINATION_MESSAGES:
        text = f"{MOST_TERMINATION_MESSAGES} messages are stored for its termination already"
        raise RequestError(Refusal.OVERLOAD, f"{task}: {text}")
    termination_messages.append((message, body))
    central.tree.grow(task, DELIVERY_BYTES + held_size(body))
    central.facts.append(facts.SendPlanned(task.id, message.name, body))
