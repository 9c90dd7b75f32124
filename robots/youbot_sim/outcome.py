"""The outcome of a delivery from its journal: each task of an agent, with its roles."""

from collections.abc import Iterable
from dataclasses import dataclass

from robots.youbot_sim.delivery import GIVEN, WAITING
from tca_tools.journal.coordinators import coordinators, work_span
from tca_tools.journal.fold import History
from tca_wire.coordination import TaskRole, read_report
from tca_wire.journal.facts import Entry
from tca_wire.life_cycles import Effect


@dataclass(frozen=True, slots=True)
class DoneTask:
    """An agent's task: its start and end in seconds since the object was given, and its successive
    roles in the machine.
    """

    agent: str
    state: str
    start: float
    end: float
    roles: tuple[TaskRole, ...]

    def __str__(self) -> str:
        roles = ", ".join(self.roles)
        return f"{self.start:6.2f} - {self.end:5.2f} s  {self.agent:8} {self.state:14} {roles}"


@dataclass(frozen=True, slots=True)
class CarriedObject:
    """The delivery of one object, from the user's hand until the robot waits again."""

    seconds: float
    tasks: tuple[DoneTask, ...]

    def with_role(self, role: TaskRole) -> list[DoneTask]:
        """Return the tasks that had this role in the end."""
        return [task for task in self.tasks if task.roles[-1] is role]

    @property
    def seconds_in_vain(self) -> float:
        """How long agents worked on tasks that turned out to be useless."""
        return sum(task.end - task.start for task in self.with_role(TaskRole.WASTED))


def read_delivery(entries: Iterable[Entry]) -> CarriedObject:
    """Read the only delivery of a journal."""
    history = History.until(entries)
    ((coordinator, record),) = coordinators(history)
    labels = [state.label for state in record.chart.states]
    reports = [
        (change.time, read_report(change.body))
        for change in coordinator.life
        if change.effect is Effect.RESULT
    ]
    known = [(time, report) for time, report in reports if report is not None]
    given = next(time for time, report in known if report.taken == GIVEN)
    waiting_again = next(
        time for time, report in known if time > given and labels[report.current] == WAITING
    )
    tasks = []
    for task in record.tasks.values():
        start, end = work_span(history, history.tasks[task.id]) or (given, given)
        roles = tuple(role for _, role in task.roles)
        # The report of the start arrives a little after the start.
        start, end = max(start - given, 0.0), max(end - given, 0.0)
        tasks.append(DoneTask(task.agent, task.state, start, end, roles))
    return CarriedObject(waiting_again - given, tuple(tasks))
