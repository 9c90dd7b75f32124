"""Checks in a journal that no activity violated a condition of the current activity."""

from dataclasses import dataclass, field

from tca_behaviours.coordination import Activity, Agent, Coordination
from tca_wire.coordination import RoleChange, TaskRole, read_report
from tca_wire.journal.facts import Entry, Killed, Received, Returned, StateChanged


@dataclass
class SeenTask:
    """A task that ran. Its times are entry numbers."""

    agents: set[Agent]
    began: int
    ended: int


@dataclass
class SeenActivity:
    """An activity that ran."""

    state: int
    activity: Activity
    tasks: dict[int, SeenTask] = field(default_factory=dict)
    entered: int | None = None
    """The number of the entry in which the activity's state was entered; None if it never was."""

    @property
    def began(self) -> int:
        return min(task.began for task in self.tasks.values())

    @property
    def ended(self) -> int:
        return max(task.ended for task in self.tasks.values())


def activities_seen(machine: Coordination, entries: list[Entry]) -> list[SeenActivity]:
    """Return the activities of a run, in the order of their starts."""
    began: dict[int, int] = {}
    ended: dict[int, int] = {}
    seen: list[SeenActivity] = []
    for number, entry in enumerate(entries):
        for fact in entry.facts:
            if isinstance(fact, Received):
                began[fact.id] = number
            elif isinstance(fact, Returned):
                ended[fact.id] = number
            elif isinstance(fact, Killed):
                ended[fact.task] = number  # at the latest, if no handler had the task
            elif isinstance(fact, StateChanged) and (report := read_report(fact.body)):
                _record_roles(machine, report.news, seen, began, number)
    for one in seen:
        for task, times in one.tasks.items():
            times.ended = ended.get(task, len(entries))
    return seen


def _record_roles(
    machine: Coordination,
    news: list[RoleChange],
    seen: list[SeenActivity],
    began: dict[int, int],
    number: int,
) -> None:
    """Record the role changes of a report. *number* is the number of the report's entry."""
    known = {task: one for one in seen for task in one.tasks}
    new: dict[tuple[int, TaskRole], SeenActivity] = {}
    for change in news:
        if change.task in known:
            if change.role is TaskRole.KEPT:
                known[change.task].entered = number
            continue
        activity = machine.states[change.state].activity
        assert activity is not None
        one = new.setdefault((change.state, change.role), SeenActivity(change.state, activity))
        if change.role is TaskRole.CURRENT:
            one.entered = began[change.task]
        agents = {agent for agent in machine.agents if agent.name in change.agent.split("+")}
        one.tasks[change.task] = SeenTask(agents, began[change.task], len(began))
    seen += new.values()


def check_conditions(machine: Coordination, entries: list[Entry]) -> None:
    """Check each activity while it is current. No other activity may use its agents, or make a fact
    that it needs or makes.
    """
    seen = activities_seen(machine, entries)
    for current in seen:
        for other in seen:
            if (
                current.entered is not None
                and other is not current
                and current.entered < current.ended
            ):
                _check_no_conflict(current, current.entered, other)


def _check_no_conflict(current: SeenActivity, entered: int, other: SeenActivity) -> None:
    if other.began < current.ended and entered < other.ended:
        conditions = current.activity.needs.keys() | current.activity.makes.keys()
        assert not other.activity.makes.keys() & conditions, (current, other)
    for mine in current.tasks.values():
        for task in other.tasks.values():
            if task.began < mine.ended and max(mine.began, entered) < task.ended:
                assert not mine.agents & task.agents, (current, other)
