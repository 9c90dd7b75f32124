"""What became of a delivery, read from the journal: when which agent did what, and what was done
ahead or in vain.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from robots.youbot_sim.delivery import GIVEN, WAITING
from tca_tools.journal.coordinators import coordinators, worked
from tca_tools.journal.fold import History
from tca_wire.coordination import TaskRole, read_report
from tca_wire.journal.facts import Entry
from tca_wire.life_cycles import Effect


@dataclass(frozen=True, slots=True)
class DoneTask:
    """A task of an agent, from when until when (seconds since the object was given), and what it
    was to the machine.
    """

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
    ((coordinator, record),) = coordinators(history)
    labels = [state.label for state in record.chart.states]
    reports = [
        (change.time, read_report(change.body))
        for change in coordinator.life
        if change.effect is Effect.RESULT
    ]
    told = [(time, report) for time, report in reports if report is not None]
    given = next(time for time, report in told if report.taken == GIVEN)
    waits = next(
        time for time, report in told if time > given and labels[report.current] == WAITING
    )
    tasks = []
    for one in record.tasks.values():
        start, end = worked(history, history.tasks[one.id]) or (given, given)
        roles = tuple(role for _, role in one.roles)
        start, end = (
            max(start - given, 0.0),
            max(end - given, 0.0),
        )  # the report that it began is a bit later
        tasks.append(DoneTask(one.agent, one.state, start, end, roles))
    return CarriedObject(waits - given, tuple(tasks))
