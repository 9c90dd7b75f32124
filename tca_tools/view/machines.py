"""State machines of tasks: a picture, and the active and foreseen states at an instant."""

from functools import lru_cache
from typing import Any

from tca_tools.drawing.chart_dot import chart_dot, likely_arrows
from tca_tools.drawing.graphviz import render
from tca_tools.errors import NoPicture
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.records import OVER, Task
from tca_tools.journal.whole_run import Run
from tca_tools.view.reading import Reading
from tca_wire.charts import MachineChart, read_active, read_machine
from tca_wire.coordination import read_report
from tca_wire.text.early_work import why_not_early

_MOST_STATES = 200
"""A picture of a larger machine would not be readable."""


def machine_answer(at: RunAt, task: TaskAt) -> dict[str, Any]:
    """Return the active and foreseen states of a task that is a state machine; else nothing."""
    if (chart := _machine(at.run, task.record)) is None:
        return {}
    progress = b"" if task.state in OVER else task.life.progress
    if not chart.is_coordinated:
        return {"machine": {"active": _known(chart, read_active(progress).active)}}
    if (report := read_report(progress)) is None:
        return {"machine": {"active": [], "foreseen": [], "likely": {}}}
    foreseen = _known(chart, [one.state for one in report.preview])
    return {
        "machine": {
            "active": _known(chart, [report.current]),
            "foreseen": foreseen,
            "likely": likely_arrows(chart, report),
            "late": [str(why_not_early(chart, one)) for one in report.refused],
        }
    }


def _known(chart: MachineChart, numbers: list[int]) -> list[int]:
    return [number for number in numbers if 0 <= number < len(chart.states)]


def machine_picture(reading: Reading, task_id: int) -> dict[str, str] | None:
    """Return a machine's picture, or why it can't be drawn; None if the task is not a machine."""
    with reading:
        run = reading.feed.history
        task = run.tasks.get(task_id)
        chart = _machine(run, task) if task is not None else None
    if chart is None:
        return None
    if len(chart.states) > _MOST_STATES:
        return {"problem": f"{len(chart.states)} states are too many for a picture"}
    try:
        return {"svg": _picture(chart_dot(chart))}
    except NoPicture as error:
        return {"problem": error.message}


def _machine(run: Run, task: Task) -> MachineChart | None:
    known = run.formats.get(task.name)
    return read_machine(known.data, task.body) if known is not None else None


@lru_cache(maxsize=16)
def _picture(source: str) -> str:
    return render(source, "svg").decode()
