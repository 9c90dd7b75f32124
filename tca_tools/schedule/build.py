"""From a run to the schedules of its coordinators: for each agent its tasks, and the gaps in which it waits. Pure.

Times are seconds since the coordinator's first task began.
"""

from dataclasses import dataclass, field
from operator import attrgetter

from tca_tools.gantt.chart import Bar
from tca_tools.journal.coordinators import STANDINGS, CoordinatorRecord, SentByCoordinator, coordinators, worked
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_tools.spans import lanes
from tca_wire.coordination import TaskRole
from tca_wire.text.bodies import plain_data
from tca_wire.text.measures import from_to
from tca_wire.text.printable import printable

CURRENT = "of the current state"


@dataclass(slots=True)
class AgentRow:
    """The tasks of an agent, and from when until when it has none."""

    agent: str
    boxes: list[Bar]
    gaps: list[tuple[float, float]]


@dataclass(slots=True)
class AgentSchedule:
    """What the agents of one coordinator did."""

    seconds: float
    """From the first task to the end of the last."""
    rows: list[AgentRow]
    title: str = ""
    notes: list[str] = field(default_factory=list)
    """Why activities did not start early."""


def schedules(run: Run, name: str) -> list[AgentSchedule]:
    """The schedules of all coordinators of the run *name* that have begun a task."""
    made = {str(task): _schedule(run, record) for task, record in coordinators(run)}
    found = [(task, one) for task, one in made.items() if one]
    for task, one in found:
        one.title = f"{name}, {task}" if len(found) > 1 else name
    return [one for _, one in found]


def _schedule(run: Run, record: CoordinatorRecord) -> AgentSchedule | None:
    spans = {one.id: span for one in record.tasks.values() if (span := worked(run, run.tasks[one.id]))}
    if not spans:
        return None
    start, end = min(span[0] for span in spans.values()), max(span[1] for span in spans.values())
    boxes = {one.id: _box(run, one, spans[one.id], start) for one in record.tasks.values() if one.id in spans}
    rows = []
    for agent in record.chart.agents:
        tasks = [one for one in record.tasks.values() if f"+{agent}+" in f"+{one.agent}+"]
        whose = [boxes[one.id] for one in tasks if one.id in boxes]
        rows.append(_row(agent, whose, end - start))
    return AgentSchedule(end - start, rows, notes=[printable(str(why)) for why in record.late()])


def _box(run: Run, one: SentByCoordinator, span: tuple[float, float], zero: float) -> Bar:
    task, start, end = run.tasks[one.id], span[0] - zero, span[1] - zero
    values = _values(task)
    words = "undo " * (one.role() is TaskRole.RESTORING) + task.name + f"({values})" * bool(values)
    about = task, one.state, STANDINGS.get(one.role(), ""), start, end
    box = Bar(words, start, end, _title, about, is_open=not task.has_ended, brief=values)
    if one.is_early:
        box.ahead_until, box.is_wasted = one.entered - zero, one.is_wasted
    return box


def _values(task: Task) -> str:
    """Its data in brief: ``box B, 0.5``."""
    data = plain_data(task.body)
    values = list(data.values()) if isinstance(data, dict) else [] if data is None else [data]
    return printable(", ".join(map(str, values)))


def _title(task: Task, state: str, standing: str, start: float, end: float) -> str:
    """``move arm {10} for the state 'arm to box C' (ahead, kept), from 0.800 s to 1.005 s``."""
    return f"{task} for the state '{state}'{standing and f' ({standing})'}, {from_to(start, end)}"


def _row(agent: str, boxes: list[Bar], seconds: float) -> AgentRow:
    boxes = sorted(boxes, key=attrgetter("start"))
    for box, lane in zip(boxes, lanes((box.start, box.end) for box in boxes), strict=True):
        box.lane = lane
    gaps, last = [], 0.0
    for start, end in [*((box.start, box.end) for box in boxes), (seconds, seconds)]:
        if start > last:
            gaps.append((last, start))
        last = max(last, end)
    return AgentRow(agent, boxes, gaps)
