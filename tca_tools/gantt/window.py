"""Which bars of a run are asked for, and from when until when their chart goes. Pure."""

from collections.abc import Container
from dataclasses import dataclass
from functools import partial

from tca_tools.gantt.chart import ResourceRow
from tca_tools.journal.fates import watches
from tca_tools.journal.records import OVER, Task
from tca_tools.journal.whole_run import Run

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

    def is_asked(self, number: int) -> bool:
        """Whether a message is asked for itself."""
        return self.messages is None or number in self.messages

    def message(self, number: int) -> bool:
        """Whether a message has bars."""
        return self.is_asked(number) or number in self.beside


ALL = Pick()


def span_of(
    rows: list[ResourceRow], run: Run, pick: Pick, start: float | None, end: float | None
) -> tuple[float, float]:
    """From when until when the chart goes: what was not asked for is where things happened, with a
    little room; of a run in which something goes on, until now. Who is just connected, or still has
    a lock, makes it no longer.
    """
    now = run.time
    start, end = (pick.since if start is None else start), (pick.until if end is None else end)
    bars = [bar for row in rows for bar in row.bars]
    claims = [one for row in rows for one in row.claims] if pick.messages is None else []
    times = [mark.time for bar in bars for mark in bar.marks]
    times += [one.start for one in (*bars, *claims)] + [bar.end for bar in bars]
    times += [one.end for one in claims if not one.is_open]
    first, last = min(times, default=0.0), max(times, default=now)
    room = (last - first) * ROOM
    start = max(first - room, 0.0) if start is None else start
    if end is None:
        goes_on = any(bar.is_open for bar in bars) or any(
            map(partial(_is_at_it, run, pick), run.tasks.values())
        )
        end = now if run.is_live and goes_on else min(last + room, now)
    return start, max(end, start)


def _is_at_it(run: Run, pick: Pick, task: Task) -> bool:
    """Whether a task, which may be held and have no bar, goes on and does more than to watch, or to
    wait for what is under it.
    """
    if task.state in OVER or not pick.message(task.id) or watches(task, task.state):
        return False
    return all(run.tasks[child].state in OVER for child in task.children)
