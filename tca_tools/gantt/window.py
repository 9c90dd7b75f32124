"""Which bars of a run are asked for, and from when until when their chart goes. Pure."""

from collections.abc import Container, Iterator
from dataclasses import dataclass

from tca_tools.gantt.chart import Row
from tca_tools.run.fates import watches
from tca_tools.run.records import OVER, Task
from tca_tools.run.whole_run import Run

ROOM = 0.02
"""Beside the bars, of the time that they take."""


@dataclass(frozen=True, slots=True)
class Pick:
    """Which bars are asked for."""

    modules: Container[str] | None = None
    """Only in the rows of these modules."""
    messages: Container[int] | None = None
    """Only of these messages ..."""
    beside: Container[int] = ()
    """... and, paler, of these."""
    held: Container[int] = ()
    """Of which tasks it is shown when they were held, and why."""
    since: float | None = None
    """When what is asked for began: there the chart begins if nothing else is asked for ..."""
    until: float | None = None
    """... and there it ends: when that ended."""

    def row(self, module: str) -> bool:
        """Whether a module has rows."""
        return self.modules is None or module in self.modules

    def message(self, number: int) -> bool:
        """Whether a message has bars."""
        return self.messages is None or number in self.messages or number in self.beside


ALL = Pick()


def span_of(rows: list[Row], run: Run, pick: Pick, start: float | None, end: float | None) -> tuple[float, float]:
    """From when until when the chart goes: what was not asked for is where things happened, with a little room; of a
    run in which something goes on, until now. Who is just connected, or still has a lock, makes it no longer.
    """
    now = run.time
    start, end = (pick.since if start is None else start), (pick.until if end is None else end)
    times = [*_moments(rows, with_locks=pick.messages is None)] or [0.0, now]
    first, last = min(times), max(times)
    room = (last - first) * ROOM
    start = max(first - room, 0.0) if start is None else start
    if end is None:
        end = now if run.is_live and _goes_on(rows, run, pick) else min(last + room, now)
    return start, max(end, start)


def _moments(rows: list[Row], *, with_locks: bool) -> Iterator[float]:
    """When something began or ended that has a bar."""
    for row in rows:
        for bar in row.bars:
            yield from (bar.start, bar.end, *(mark.time for mark in bar.raised))
        for one in row.claims if with_locks else ():
            yield one.start
            if not one.is_open:
                yield one.end


def _goes_on(rows: list[Row], run: Run, pick: Pick) -> bool:
    """Whether something has not ended: a bar, or a task that has none, since it is held."""
    if any(bar.is_open for row in rows for bar in row.bars):
        return True
    return any(task.state not in OVER and pick.message(task.id) and _is_at_it(run, task) for task in run.tasks.values())


def _is_at_it(run: Run, task: Task) -> bool:
    """Whether a task that has not ended does more than to watch, or to wait for what is under it."""
    return not watches(task, task.state) and all(run.tasks[child].state in OVER for child in task.children)
