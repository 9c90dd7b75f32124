"""Coordinators with a preview: which tasks they sent ahead of their states, and what that gained.
Pure.

Each report of a coordinator is read once, when somebody asks for the first time after it came.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from operator import itemgetter
from typing import NamedTuple

from tca_tools.journal.records import HandlerWait, Handling, Task
from tca_tools.journal.whole_run import Run
from tca_wire.charts import MachineChart, read_machine
from tca_wire.coordination import CoordinationReport, TaskRole, read_report
from tca_wire.life_cycles import Effect
from tca_wire.points import Moment
from tca_wire.text.early_work import WhyNotEarly, late_objections, why_not_early

_EARLY = (TaskRole.AHEAD, TaskRole.KEPT, TaskRole.WASTED)
_TIME = itemgetter(0)


STANDINGS: dict[TaskRole | None, str] = {
    TaskRole.AHEAD: "ahead",
    TaskRole.KEPT: "ahead, kept",
    TaskRole.WASTED: "ahead, wasted",
    TaskRole.RESTORING: "restoring",
}
"""What a task is to its machine, in words; of one that was sent for the current state there is
nothing to say.
"""


@dataclass(slots=True)
class SentByCoordinator:
    """A task that a coordinator sent: for which state, and what it was to its machine since
    when.
    """

    id: int
    state: str
    """Its label."""
    agent: str
    roles: list[tuple[float, TaskRole]] = field(default_factory=list)

    def role(self, moment: float = inf) -> TaskRole | None:
        """What it was at a moment; None before the first report of it."""
        begun = bisect_right(self.roles, moment, key=_TIME)
        return self.roles[begun - 1][1] if begun else None

    @property
    def is_early(self) -> bool:
        """Whether it was sent ahead of its state."""
        return self.roles[0][1] in _EARLY

    @property
    def entered(self) -> float:
        """When its state was entered; inf if it was not."""
        return next(
            (time for time, role in self.roles if role in (TaskRole.KEPT, TaskRole.CURRENT)), inf
        )

    @property
    def is_wasted(self) -> bool:
        """Whether it was sent ahead for nothing."""
        return self.roles[-1][1] is TaskRole.WASTED


class CoordinatorRecord:
    """What the reports of a coordinator tell of its tasks."""

    def __init__(self, chart: MachineChart) -> None:
        self.chart = chart
        self.tasks: dict[int, SentByCoordinator] = {}
        self.predictions: list[bool] = []
        """Of each activity begun ahead, of which it is known: whether its state was entered."""
        self._late = Counter[WhyNotEarly]()
        self._told = CoordinationReport(-1)
        self._read = 0

    def label(self, state: int) -> str:
        """The label of a state; "" if there is no such state."""
        return self.chart.states[state].label if 0 <= state < len(self.chart.states) else ""

    def read_on(self, run: Run, coordinator: Task) -> None:
        """Take in the reports that have come since."""
        for change in coordinator.life[self._read :]:
            report = read_report(change.body) if change.effect is Effect.RESULT else None
            if report is not None:
                self._late.update(
                    why_not_early(self.chart, one) for one in late_objections(self._told, report)
                )
                self._told = report
            outcomes = set[tuple[int, bool]]()
            for news in report.news if report is not None else ():
                task = run.tasks.get(news.task)
                if task is None or task.parent != coordinator.id:
                    continue
                if task.id not in self.tasks:
                    self.tasks[task.id] = SentByCoordinator(
                        task.id, self.label(news.state), news.agent
                    )
                self.tasks[task.id].roles.append((change.time, news.role))
                if news.role in (TaskRole.KEPT, TaskRole.WASTED):
                    outcomes.add((news.state, news.role is TaskRole.KEPT))
            self.predictions += (is_right for _, is_right in sorted(outcomes))
        self._read = len(coordinator.life)
        if coordinator.has_ended:
            self._waste_rest(coordinator.time_of(Moment.END_ACHIEVING))

    def late(self) -> Counter[WhyNotEarly]:
        """Why activities did not start before their turn, and how often. Where nothing ran ahead,
        reasons without a remedy are told, too.
        """
        has_early = any(task.is_early for task in self.tasks.values())
        return Counter(
            {why: times for why, times in self._late.items() if why.remedy or not has_early}
        )

    def _waste_rest(self, end: float) -> None:
        """The run has ended: what is still ahead then, as it died, was in vain."""
        rest = [task for task in self.tasks.values() if task.role() is TaskRole.AHEAD]
        self.predictions += [False] * len({task.state for task in rest})
        for task in rest:
            task.roles.append((end, TaskRole.WASTED))


def coordinator_of(run: Run, task: Task) -> CoordinatorRecord | None:
    """The record of a task that is a coordinator; None of another one."""
    if not task.life:  # as most
        return None
    key = CoordinatorRecord, task.id
    if key not in run.memo:
        known = run.formats.get(task.name)
        chart = read_machine(known.data, task.body) if known is not None else None
        run.memo[key] = (
            CoordinatorRecord(chart) if chart is not None and chart.is_coordinated else None
        )
    record: CoordinatorRecord | None = run.memo[key]
    if record is not None:
        record.read_on(run, task)
    return record


def agent_task(run: Run, task: Task) -> SentByCoordinator | None:
    """What a task is to the coordinator that sent it; None if none did."""
    above = run.tasks.get(task.parent)
    record = coordinator_of(run, above) if above is not None else None
    return record.tasks.get(task.id) if record is not None else None


def ends_waited_for(run: Run, handling: Handling) -> list[HandlerWait]:
    """The waits of a coordinator for its tasks, except those that it sent in vain. It waits for
    whatever comes first, so the journal has none of them.
    """
    coordinator = run.tasks.get(handling.message_id)
    record = coordinator_of(run, coordinator) if coordinator is not None else None
    sent = (
        [run.tasks[one.id] for one in record.tasks.values() if not one.is_wasted]
        if record is not None
        else []
    )
    return [
        HandlerWait(
            task.id,
            task.received,
            Moment.END_ACHIEVING,
            task.time_of(Moment.END_ACHIEVING),
            handling,
        )
        for task in sent
        if task.has_ended and task.by is handling
    ]


def coordinators(run: Run) -> Iterator[tuple[Task, CoordinatorRecord]]:
    """All of a run that have reported, oldest first."""
    for task in run.tasks.values():
        if (record := coordinator_of(run, task)) is not None:
            yield task, record


def worked(run: Run, task: Task) -> tuple[float, float] | None:
    """From when until when a task was handled and what is under it done; None if that never
    began.
    """
    if not task.handlings:
        return None
    return task.handlings[0].start, min(task.time_of(Moment.END_ACHIEVING), run.time)


class Gain(NamedTuple):
    """What a preview came to. Seconds of tasks that ran side by side are added up."""

    right: int
    """Activities begun ahead whose states were entered, and of which they were not."""
    wrong: int
    kept: float
    """Seconds that tasks ran ahead of states that were entered then: those that plain execution
    would have needed.
    """
    wasted: float
    restored: float
    """Seconds that it took to undo what was wasted."""
    seconds: float
    """How long the machine ran."""


def gains(run: Run) -> list[tuple[str, int, Gain, Counter[WhyNotEarly]]]:
    """The gain of each machine, with how often it ran, and why activities did not start early, how
    often.
    """
    machines: dict[str, list[Gain]] = {}
    late: dict[str, Counter[WhyNotEarly]] = {}
    for task, record in coordinators(run):
        machines.setdefault(record.chart.name, []).append(gain(run, task, record))
        late.setdefault(record.chart.name, Counter()).update(record.late())
    sums = {
        machine: Gain._make(map(sum, zip(*some, strict=True))) for machine, some in machines.items()
    }
    return [
        (machine, len(some), sums[machine], late[machine]) for machine, some in machines.items()
    ]


def gain(run: Run, coordinator: Task, record: CoordinatorRecord) -> Gain:
    """What running ahead gained a machine, and cost."""
    seconds = dict.fromkeys(TaskRole, 0.0)
    for one in record.tasks.values():
        role, span = one.role(), worked(run, run.tasks[one.id])
        if span is not None and role is not None:
            seconds[role] += max(min(span[1], one.entered) - span[0], 0.0)
    right, whole = sum(record.predictions), worked(run, coordinator)
    return Gain(
        right,
        len(record.predictions) - right,
        seconds[TaskRole.KEPT],
        seconds[TaskRole.WASTED],
        seconds[TaskRole.RESTORING],
        whole[1] - whole[0] if whole else 0.0,
    )
