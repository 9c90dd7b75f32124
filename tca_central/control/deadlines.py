"""Deadlines: a point of a task must be reached in time, or the failure "timeout" is raised on it."""

from tca_central.control.pending import check_pending
from tca_central.failing.failures import raise_failure
from tca_central.model.clock import checked_seconds
from tca_central.model.deliveries import Connection
from tca_central.model.intervals import checked_moment
from tca_central.model.task_tree import Task
from tca_central.state import RaisedFailure, State
from tca_wire.journal import facts
from tca_wire.messages.failures import TIMEOUT
from tca_wire.packets import headers
from tca_wire.points import TaskId, describe_moments
from tca_wire.vocabulary import Due


class PendingDeadline:
    """A task's point that must be reached in time."""

    __slots__ = ("moment", "seconds", "task")

    def __init__(self, task: Task, moment: int, seconds: float) -> None:
        self.task, self.moment, self.seconds = task, moment, seconds

    @property
    def is_missed(self) -> bool:
        """Whether the point has not been reached, and may still be."""
        return not self.task.killed and not self.task.reached & self.moment


def set_deadline(central: State, task: Task, moment: int, seconds: float) -> None:
    """Let the failure "timeout" be raised on *task* if *moment* is not reached within *seconds* from now."""
    deadline = PendingDeadline(task, moment, seconds)
    task.more.pending[deadline] = central.clock.after(seconds, Due.DEADLINE, deadline)
    central.facts.append(facts.DeadlineSet(TaskId(task.id), moment, seconds))


def on_time_out(central: State, deadline: PendingDeadline) -> None:
    """A deadline is over."""
    task = deadline.task
    del task.more.pending[deadline]
    if deadline.is_missed:
        what = describe_moments(deadline.moment)[0]
        raise_failure(central, task, RaisedFailure(TIMEOUT, f"{what} not reached within {deadline.seconds:g} s"))


def on_deadline(central: State, connection: Connection, header: headers.Deadline, _: bytes) -> None:
    """A module bounds the time until a point of a task."""
    checked_seconds(header.seconds, f"a deadline of task {header.point.task}")
    moment = checked_moment(header.point)
    task = central.living(connection, header.number, header.point.task, "no deadline can be set")
    if task is None:
        return
    if not task.reached & moment:
        check_pending(task)
        set_deadline(central, task, moment, header.seconds)
    central.accept(connection, header.number, header.point.task)
