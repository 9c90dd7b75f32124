"""The selection of a run's bars, and the span of time of their chart."""

from collections.abc import Container
from dataclasses import dataclass
from functools import partial

from tca_tools.gantt.chart import ResourceRow
from tca_tools.journal.fates import is_watching
from tca_tools.journal.records import OVER, Task
from tca_tools.journal.whole_run import Run

MARGIN_SHARE = 0.02
"""The margin before and after the bars, as a part of their time."""


@dataclass(frozen=True, slots=True)
class Pick:
    """A selection of bars."""

    modules: Container[str] | None = None
    """The modules with rows; None for all."""
    messages: Container[int] | None = None
    """The selected messages; None for all."""
    context: Container[int] = ()
    """Further messages, whose bars are paler."""
    held: Container[int] = ()
    """The tasks with a bar while they are held."""
    since: float | None = None
    """The default start of the chart: the start of the selected task."""
    until: float | None = None
    """The default end of the chart: the end of the selected task."""

    def has_row(self, module: str) -> bool:
        """Whether a module has rows."""
        return self.modules is None or module in self.modules

    def is_selected(self, number: int) -> bool:
        """Whether a message is selected itself, not as context."""
        return self.messages is None or number in self.messages

    def has_bars(self, number: int) -> bool:
        """Whether a message has bars."""
        return self.is_selected(number) or number in self.context


ALL = Pick()


def span_of(
    rows: list[ResourceRow], run: Run, pick: Pick, start: float | None, end: float | None
) -> tuple[float, float]:
    """Return the start and end of a chart.

    By default the chart covers all bars, with a margin. If the run is live and a task is active,
    the chart ends now. Connections, and locks that are still held, do not extend the chart.
    """
    now = run.time
    start, end = (pick.since if start is None else start), (pick.until if end is None else end)
    bars = [bar for row in rows for bar in row.bars]
    claims = [one for row in rows for one in row.claims] if pick.messages is None else []
    times = [mark.time for bar in bars for mark in bar.marks]
    times += [one.start for one in (*bars, *claims)] + [bar.end for bar in bars]
    times += [one.end for one in claims if not one.is_open]
    first, last = min(times, default=0.0), max(times, default=now)
    room = (last - first) * MARGIN_SHARE
    start = max(first - room, 0.0) if start is None else start
    if end is None:
        is_active = any(bar.is_open for bar in bars) or any(
            map(partial(_is_active, run, pick), run.tasks.values())
        )
        end = now if run.is_live and is_active else min(last + room, now)
    return start, max(end, start)


def _is_active(run: Run, pick: Pick, task: Task) -> bool:
    """Whether a task is open and does more than watch or wait for its subtasks.

    A held task counts, too, although it may have no bar.
    """
    if task.state in OVER or not pick.has_bars(task.id) or is_watching(task, task.state):
        return False
    return all(run.tasks[child].state in OVER for child in task.children)
