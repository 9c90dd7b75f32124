"""Find the records of a task that are active in a span, in O(log n) if the task has many. Pure.

If a task has few records, all of them are returned, since a search would cost more.
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
"""Up to this number of records, all are returned."""


def children_within(
    run: Run, task: Task, moment: int, start: float, end: float
) -> Sequence[TaskId]:
    """Return the children sent by *end* that had not reached *moment* by *start*; all, if few."""
    return _within(run, task.children, (task.id, moment), moment, start, end)


def called_within(run: Run, task: Task, start: float, end: float) -> Sequence[TaskId]:
    """Return the exception handlers called by *end* that had not ended by *start*; all, if few."""
    return _within(run, task.caught_by, (called_within, task.id), END_ACHIEVING, start, end)


def _within(
    run: Run, tasks: Sequence[TaskId], key: object, moment: int, start: float, end: float
) -> Sequence[TaskId]:
    if len(tasks) <= _FEW:
        return tasks

    def span(number: TaskId) -> tuple[float, float]:
        known = run.tasks.get(number)
        return run.sent_at(number), known.time_of(moment) if known else inf

    return cached(run, key, lambda: Overlaps(tasks, span)).within(start, end)


def has_many(task: Task) -> bool:
    """Whether a task has too many records to read all of them each time."""
    records = (
        task.stages,
        task.handlings,
        task.queueings,
        task.holds,
        task.suspensions,
        task.caught_by,
    )
    return sum(map(len, records)) > 2 * _FEW


def cached(run: Run, key: object, compute: Callable[[], _T]) -> _T:
    """Return a result, computed again only after the run has got new entries."""
    known: tuple[int, _T] | None = run.memo.get(key)
    if known is None or known[0] != len(run.times):
        known = run.memo[key] = len(run.times), compute()
    return known[1]
