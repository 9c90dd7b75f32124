"""What became of a delivery, read from the journal: when which agent did what, and what was done ahead or in vain."""

from collections.abc import Iterable
from dataclasses import dataclass

from robots.youbot_sim.delivery import GIVEN, WAITING
from tca_tools.run.fold import History
from tca_tools.run.records import Task
from tca_wire.coordination import CoordinationChart, CoordinationReport, TaskRole, read_chart, read_report
from tca_wire.journal.facts import Entry
from tca_wire.life_cycles import Effect
from tca_wire.points import Moment


@dataclass(frozen=True, slots=True)
class DoneTask:
    """A task of an agent, from when until when (seconds since the object was given), and what it was to the machine."""

    agent: str
    state: str
    start: float
    end: float
    roles: tuple[TaskRole, ...]

    def __str__(self) -> str:
        return f"{self.start:6.2f} - {self.end:5.2f} s  {self.agent:8} {self.state:14} {', '.join(self.roles)}"


@dataclass(frozen=True, slots=True)
class CarriedObject:
    """One object, from the hand of the user until the robot waits again."""

    seconds: float
    tasks: tuple[DoneTask, ...]

    def with_role(self, role: TaskRole) -> list[DoneTask]:
        """The tasks that were that in the end."""
        return [task for task in self.tasks if task.roles[-1] is role]

    @property
    def seconds_in_vain(self) -> float:
        """How long agents worked on what was of no use."""
        return sum(task.end - task.start for task in self.with_role(TaskRole.WASTED))


def read_delivery(entries: Iterable[Entry]) -> CarriedObject:
    """The delivery of a journal that holds one."""
    history = History.until(entries)
    runs = ((_chart(history, task), task) for task in history.tasks.values())
    chart, run = next((chart, task) for chart, task in runs if chart is not None)
    reports = [(change.time, read_report(change.body)) for change in run.life if change.effect is Effect.RESULT]
    told = [(time, report) for time, report in reports if report is not None]
    given = next(time for time, report in told if report.taken == GIVEN)
    waits = (time for time, report in told if time > given and chart.states[report.current].label == WAITING)
    return CarriedObject(next(waits) - given, tuple(_tasks(history, chart, [report for _, report in told], given)))


def _chart(history: History, task: Task) -> CoordinationChart | None:
    known = history.formats.get(task.name)
    return read_chart(known.data, task.body) if known is not None else None


def _tasks(
    history: History, chart: CoordinationChart, reports: Iterable[CoordinationReport], given: float
) -> Iterable[DoneTask]:
    """In the order in which they began."""
    changes = [change for report in reports for change in report.news]
    for number in dict.fromkeys(change.task for change in changes):
        own = [change for change in changes if change.task == number]
        task = history.tasks[number]
        start, end = (task.time_of(moment) - given for moment in (Moment.START_HANDLING, Moment.END_HANDLING))
        yield DoneTask(own[0].agent, chart.states[own[0].state].label, start, end, tuple(change.role for change in own))
