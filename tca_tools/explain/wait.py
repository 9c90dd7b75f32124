"""A wait as the list of waits has it: one cause, one span, and the moments that it holds back (waits.py)."""

from collections.abc import Sequence
from typing import NamedTuple

from tca_tools.journal.records import HandlerWait, Handling, Hold, Queueing, Suspension
from tca_tools.journal.whole_run import Run
from tca_wire.points import END_HANDLING
from tca_wire.waits import WaitKind

_LEAVES = (WaitKind.HANDLER, WaitKind.DELAY, WaitKind.CONDITION, WaitKind.RUNNING, WaitKind.PRESENCE)


class Node(NamedTuple):
    """Something that has to come about."""

    number: int
    """The task, message or claim."""
    moment: int = 0
    """The moment that the task is to reach. 0: it is to be resumed, answered, or its claim granted or released."""
    delivery: int = 0
    """Of what was sent to many: the one of them that is to be handled (0: all)."""


class Wait(NamedTuple):
    """One thing that something waits for, and from when until when."""

    start: float
    end: float
    """inf: it goes on."""
    kind: WaitKind
    on: Node
    """The node that has to come first; of a leaf the thing itself."""
    holds: int
    """The moments of the waiting task that it keeps from being reached, as bits."""
    record: Hold | Queueing | Handling | HandlerWait | Suspension | None = None
    """The record of the wait, if that is more than a point of a task."""
    since: float = 0.0
    """Since when it has waited in all without a break, whatever for; no later than *start*."""
    others: Sequence[float] = ()
    """The ends of further subtasks that it stands for."""

    @property
    def seconds(self) -> float:
        """How long it took; infinite, if it goes on."""
        return self.end - self.start

    @property
    def is_leaf(self) -> bool:
        """Whether nothing else has to come about first."""
        is_own = isinstance(self.record, Suspension) and self.record.cause == self.record.task
        return self.kind in _LEAVES or is_own or (self.kind is WaitKind.CHANGE and not self.on.number)


def lasting(record: Queueing | Handling | HandlerWait | Suspension, kind: WaitKind, on: Node, holds: int) -> Wait:
    """A wait that lasts as long as its record."""
    return Wait(record.start, record.until, kind, on, holds, record, record.start)


def has_come(run: Run, wait: HandlerWait) -> bool:
    """Whether what a handler waited for a task for had come when the wait was over; True if it is no certain task."""
    task = run.tasks.get(wait.awaited)
    if task is None or wait.end is None:
        return task is None
    if wait.kind is WaitKind.CHANGE:
        return wait.end in task.times or any(one.time == wait.end for one in task.life or ())
    return wait.moment is None or task.time_of(wait.moment) <= wait.end


def node_of(run: Run, handling: Handling) -> Node:
    """That a run of a handler ends."""
    if handling.message_id in run.tasks:
        return Node(handling.message_id, END_HANDLING)
    is_one_of_many = handling.delivery != handling.message_id
    return Node(handling.message_id, 0, handling.delivery if is_one_of_many else 0)
