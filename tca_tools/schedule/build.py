"""Build the schedules of a run's coordinators: the tasks of each agent, and the gaps between them.

Times are seconds since the start of the coordinator's first task.
"""

from collections.abc import Iterator
from functools import partial

from tca_tools.gantt.chart import MEANINGS, Bar, BarKind, Chart, ResourceRow
from tca_tools.journal.coordinators import (
    STANDINGS,
    CoordinatorTasks,
    SentByCoordinator,
    coordinators,
    work_span,
)
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Span
from tca_wire.coordination import TaskRole
from tca_wire.text.bodies import in_words, plain_data
from tca_wire.text.measures import duration, from_to, percent
from tca_wire.text.printable import printable

LEGEND: dict[str, str] = {
    BarKind.HANDLED: "of the current state",
    TaskRole.AHEAD: MEANINGS[TaskRole.AHEAD],
    TaskRole.WASTED: MEANINGS[TaskRole.WASTED],
    BarKind.IDLE: "w: waiting",
}


def schedules(run: Run, name: str) -> list[Chart]:
    """Return the schedules of all coordinators of the run *name* that have started a task."""
    built = [(task, _schedule(run, known)) for task, known in coordinators(run)]
    found = [(task, chart) for task, chart in built if chart]
    for task, chart in found:
        chart.title = f"{name}, {task}" if len(found) > 1 else name
    return [chart for _, chart in found]


def heading(chart: Chart, longest: float) -> str:
    """Return ``free: 20 s, 65%``."""
    return f"{chart.title}: {duration(chart.end)}, {percent(chart.end / longest)}"


def _schedule(run: Run, known: CoordinatorTasks) -> Chart | None:
    sent = known.tasks.values()
    spans = {task.id: span for task in sent if (span := work_span(run, run.tasks[task.id]))}
    if not spans:
        return None
    start = min(start for start, _ in spans.values())
    seconds = max(end for _, end in spans.values()) - start
    begun = [task for task in sent if task.id in spans]
    boxes = {task.id: _box(run, task, spans[task.id], start) for task in begun}
    rows = []
    for agent in known.chart.agents:
        # A task of several agents ("base+arm") is in the row of each.
        own = [boxes[task.id] for task in begun if f"+{agent}+" in f"+{task.agent}+"]
        rows.append(ResourceRow(agent, handled=[*own, *_gaps(own, seconds)]))
        rows[-1].lay_out(0.0, seconds)
    notes = [printable(str(why)) for why in known.late_reasons()]
    return Chart(0.0, seconds, rows, [], notes=notes)


def _box(run: Run, sent: SentByCoordinator, span: Span, zero: float) -> Bar:
    task, start, end = run.tasks[sent.id], span[0] - zero, span[1] - zero
    values = _values(task)
    words = "undo " * (sent.role() is TaskRole.RESTORING) + task.name
    words += f"({values})" * bool(values)
    title = partial(_title, task, sent, start, end)
    box = Bar(words, start, end, title, is_open=not task.has_ended, short_label=values)
    if sent.is_early:
        box.early_until, box.is_wasted = sent.entered - zero, sent.is_wasted
    return box


def _values(task: Task) -> str:
    """Return the data of a task in short: ``box B, 0.5``."""
    data = in_words(plain_data(task.body))
    if data is None:
        return ""
    values = data.values() if isinstance(data, dict) else [data]
    return printable(", ".join(map(str, values)))


def _title(task: Task, sent: SentByCoordinator, start: float, end: float) -> str:
    """Return ``move arm {10} for the state 'arm to box C' (ahead, kept), from 0.8 s to 1 s``."""
    standing = STANDINGS.get(sent.role(), "")
    return (
        f"{task} for the state '{sent.state}'{standing and f' ({standing})'}, {from_to(start, end)}"
    )


def _gaps(boxes: list[Bar], seconds: float) -> Iterator[Bar]:
    """Yield the spans in which an agent has no task."""
    last = 0.0
    for start, end in [*sorted((box.start, box.end) for box in boxes), (seconds, seconds)]:
        if start > last:
            yield Bar(
                "w", last, start, partial("waits {}".format, duration(start - last)), BarKind.IDLE
            )
        last = max(last, end)
