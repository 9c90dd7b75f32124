"""Records of a task that has many, by when they go on: looking at one moment then costs no walk
through all. Pure.
"""

from collections.abc import Callable, Sequence
from math import inf
from typing import TypeVar

from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Overlaps
from tca_wire.points import END_ACHIEVING, TaskId

_T = TypeVar("_T")
_FEW = 16
"""Records that are looked through one by one."""


def children_within(
    run: Run, task: Task, moment: int, start: float, end: float
) -> Sequence[TaskId]:
    """The tasks right under a task, but for some that were sent after *end* or had reached a moment
    by *start*.
    """
    return _within(run, task.children, (task.id, moment), moment, start, end)


def called_within(run: Run, task: Task, start: float, end: float) -> Sequence[TaskId]:
    """The exception handlers of a task, but for some that were called after *end* or had ended by
    *start*.
    """
    return _within(run, task.caught_by, (called_within, task.id), END_ACHIEVING, start, end)


def _within(
    run: Run, some: Sequence[TaskId], key: object, moment: int, start: float, end: float
) -> Sequence[TaskId]:
    if len(some) <= _FEW:
        return some

    def span(number: TaskId) -> tuple[float, float]:
        known = run.tasks.get(number)
        return run.sent(number), known.time_of(moment) if known else inf

    return worked_out(run, key, lambda: Overlaps(some, span)).within(start, end)


def has_many(task: Task) -> bool:
    """Whether so much happened to a task that a look through all of it takes long."""
    some = (
        task.stages,
        task.handlings,
        task.queueings,
        task.holds,
        task.suspensions,
        task.caught_by,
    )
    return sum(map(len, some)) > 2 * _FEW


def worked_out(run: Run, key: object, work_out: Callable[[], _T]) -> _T:
    """A result that holds as long as nothing more happens in the run."""
    known: tuple[int, _T] | None = run.memo.get(key)
    if known is None or known[0] != len(run.times):
        known = run.memo[key] = len(run.times), work_out()
    return known[1]
