"""The hand on the running tree: kills now or later, suspension, deadlines, and what is to be done on termination."""

import msgspec

from tca_central.errors import RequestError
from tca_central.failing.failures import kill, raise_failure
from tca_central.model.clock import checked_seconds
from tca_central.model.intervals import SINGLE_MOMENTS
from tca_central.model.registry import Connection, MessageType
from tca_central.model.task_tree import Task, Verdict
from tca_central.outgoing.central_messages import make_task, suspend
from tca_central.state import Failure, State
from tca_wire.journal import facts
from tca_wire.messages.failures import TIMEOUT
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted
from tca_wire.points import ROOT, Point, TaskId, describe_moments
from tca_wire.vocabulary import Due, Refusal, Role, Scope

MOST_PARTING = 100
"""Messages that may be kept for the termination of one task."""

MOST_PENDING = 1000
"""Kills, deadlines and delays that may lie ahead of one task."""


# --- kill ------------------------------------------------------------------------------------------------------------


class Ending:
    """That a task shall end when a point is reached, or some time after."""

    __slots__ = ("delay", "scope", "task", "verdict")

    def __init__(self, task: Task, scope: Scope, delay: float, verdict: Verdict) -> None:
        self.task, self.scope, self.delay, self.verdict = task, scope, delay, verdict

    def met(self, central: State, _: Task) -> None:
        """The point is reached."""
        if not self.delay:
            self.now(central)
        elif self._is_there(central):
            self.task.more.pending[self] = central.clock.after(self.delay, Due.KILL, self)

    def now(self, central: State) -> None:
        """It is time."""
        if self.task.rare is not None:
            self.task.rare.pending.pop(self, None)
        if self._is_there(central):
            self._kill(central)

    def _kill(self, central: State) -> None:
        doomed = [self.task]
        if self.scope is not Scope.TASK:
            parent = self.task if self.scope is Scope.DESCENDANTS else self.task.parent
            assert parent is not None
            children = (parent.children or {}).values()
            doomed = [child for child in children if child is not self.task and not child.survives]
        for task in doomed:
            kill(central, task, self.verdict)

    def _is_there(self, central: State) -> bool:
        """Whether the task has not ended, perhaps by what let the point be reached."""
        return self.task.id == ROOT or self.task.id in central.tree.tasks


def on_kill(central: State, connection: Connection, header: headers.Kill, _: bytes) -> None:
    """A module ends a task, its descendants or its siblings; now, some time from now, or after a point."""
    if header.request:
        header = msgspec.structs.replace(header, task=_sent_with(connection, header.request))
        if not header.task:  # it has not come, and never will: it would have come before this
            central.send(connection, header.number, Accepted(header.number))
            return
    checked_seconds(header.delay, f"a kill of task {header.task} with a delay")
    is_all = header.task == ROOT and header.scope is Scope.DESCENDANTS
    task = central.tree.root if is_all else central.tree.task(header.task)
    if task is None:
        central.ignore(connection, header.number, f"task {header.task} has ended: it can't be killed")
        return
    by = connection.module.name
    verdict = Verdict(header.why, by, central.origin)
    ending = Ending(task, header.scope, header.delay, verdict)
    at = central.tree.task(header.after.task) if header.after is not None else None
    if header.after is not None and at is not None and not at.reached & _moment(header.after):
        _check_pending(task)
        task.more.pending[ending] = at
        central.facts.append(_planned(ending, header.after))
        central.agenda.wait(at, _moment(header.after), ending)
    else:
        if header.delay:
            _check_pending(task)
            central.facts.append(_planned(ending, None))
        ending.met(central, task)
    central.send(connection, header.number, Accepted(header.number, header.task))


def _planned(ending: Ending, after: Point | None) -> facts.KillPlanned:
    why, by = ending.verdict.why, ending.verdict.by
    return facts.KillPlanned(TaskId(ending.task.id), ending.scope, after, ending.delay, why, by)


def _sent_with(connection: Connection, request: int) -> TaskId:
    """The task that came with a request of a connection; 0: none did."""
    answer, _ = connection.answers.get(request, (None, b""))
    return TaskId(answer.id if isinstance(answer, Accepted) else 0)


def _check_pending(task: Task) -> None:
    if task.rare is not None and len(task.rare.pending) >= MOST_PENDING:
        raise RequestError(Refusal.OVERLOAD, f"{MOST_PENDING} kills, deadlines and delays lie ahead of {task} already")


def _moment(point: Point) -> int:
    if int(point.moment) not in SINGLE_MOMENTS:
        raise RequestError(Refusal.PROTOCOL, f"{int(point.moment)} is no moment: one bit of 1 to 32 is")
    return int(point.moment)


def check_parting(message: MessageType, task_id: int) -> None:
    """Raises RequestError if that message can't be kept for the termination of that task."""
    if not (message.message_class.is_task and message.message_class.may_react):
        text = f"{message.message_class} '{message.name}' can't be sent on termination: goals and commands can"
        raise RequestError(Refusal.PROTOCOL, text)
    if task_id == ROOT:
        text = f"'{message.name}' can't be sent on the termination of the root: it never ends"
        raise RequestError(Refusal.PROTOCOL, text)


def keep_for_termination(central: State, task: Task, message: MessageType, body: bytes) -> None:
    """Keep a message that is to be sent when the task is killed after it was started (TDL: ON TERMINATE). Of a killed
    task whose handler goes on, which may not know of it yet, it is sent now: what it is to leave safe may be under way.
    """
    if task.killed and task.slot is None:
        text = f"{task} was killed and its handler is done: '{message.name}' is not sent on its termination any more"
        raise RequestError(Refusal.TOO_LATE, text)
    if task.killed:
        make_task(central, message, body, task, Role.TERMINATION)
        return
    if len(task.more.parting) >= MOST_PARTING:
        raise RequestError(Refusal.OVERLOAD, f"{MOST_PARTING} messages wait for the termination of {task} already")
    task.more.parting.append((message, body))
    central.facts.append(facts.SendPlanned(TaskId(task.id), message.name, body))


# --- suspend ---------------------------------------------------------------------------------------------------------


def on_suspend(central: State, connection: Connection, header: headers.Suspend, _: bytes) -> None:
    """A module suspends or resumes a task with all under it (TCM: Suspend, Unsuspend)."""
    task = central.tree.task(header.task)
    if task is None:
        central.ignore(connection, header.number, f"task {header.task} has ended: it can't be suspended or resumed")
        return
    suspend(central, task, resume=header.resume, by=connection.module.name)
    central.send(connection, header.number, Accepted(header.number, task.id))


# --- deadlines -------------------------------------------------------------------------------------------------------


class Bound:
    """That a task's point must be reached in time."""

    __slots__ = ("moment", "seconds", "task")

    def __init__(self, task: Task, moment: int, seconds: float) -> None:
        self.task, self.moment, self.seconds = task, moment, seconds

    @property
    def is_missed(self) -> bool:
        """Whether the point has not been reached, and may still be."""
        return not self.task.killed and not self.task.reached & self.moment


def set_deadline(central: State, task: Task, moment: int, seconds: float) -> None:
    """Let the failure "timeout" be raised on *task* if *moment* is not reached within *seconds* from now."""
    bound = Bound(task, moment, seconds)
    task.more.pending[bound] = central.clock.after(seconds, Due.DEADLINE, bound)
    central.facts.append(facts.DeadlineSet(TaskId(task.id), moment, seconds))


def on_time_out(central: State, bound: Bound) -> None:
    """A deadline is over."""
    task = bound.task
    del task.more.pending[bound]
    if bound.is_missed:
        what = describe_moments(bound.moment)[0]
        raise_failure(central, task, Failure(TIMEOUT, f"{what} not reached within {bound.seconds:g} s"))


def on_deadline(central: State, connection: Connection, header: headers.Deadline, _: bytes) -> None:
    """A module bounds the time until a point of a task."""
    checked_seconds(header.seconds, f"a deadline of task {header.point.task}")
    task, moment = central.tree.task(header.point.task), _moment(header.point)
    if task is None or task.killed:
        ended = f"task {header.point.task} has ended" if task is None else f"{task} was killed"
        central.ignore(connection, header.number, f"{ended}: no deadline can be set")
        return
    if not task.reached & moment:
        _check_pending(task)
        set_deadline(central, task, moment, header.seconds)
    central.send(connection, header.number, Accepted(header.number, header.point.task))


def forget_pending(central: State, task: Task) -> None:
    """A task has ended: nothing that waited to happen to it will."""
    assert task.rare is not None
    for what, waits_for in task.rare.pending.items():
        if isinstance(waits_for, Task):
            central.agenda.stop_waiting(waits_for, what)
        else:
            central.clock.cancel(waits_for)
    task.rare.pending.clear()
