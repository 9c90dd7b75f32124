"""Coordinators with a preview: their early work, and the time it gained. Pure.

Each report of a coordinator is read once, at the first request after it.
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
"""The words for a task's role for its machine; none for tasks of the current state."""


@dataclass(slots=True)
class SentByCoordinator:
    """A task that a coordinator sent: its state, and its roles for the machine over time."""

    id: int
    state: str
    """The state's label."""
    agent: str
    roles: list[tuple[float, TaskRole]] = field(default_factory=list)

    def role(self, instant: float = inf) -> TaskRole | None:
        """Return its role at an instant; None before the first report of it."""
        begun = bisect_right(self.roles, instant, key=_TIME)
        return self.roles[begun - 1][1] if begun else None

    @property
    def is_early(self) -> bool:
        """Whether it was sent ahead of its state."""
        return self.roles[0][1] in _EARLY

    @property
    def entered(self) -> float:
        """When its state was entered; inf if it was not."""
        entered = (TaskRole.KEPT, TaskRole.CURRENT)
        return next((time for time, role in self.roles if role in entered), inf)

    @property
    def is_wasted(self) -> bool:
        """Whether it was early work that was wasted."""
        return self.roles[-1][1] is TaskRole.WASTED


class CoordinatorTasks:
    """The tasks that a coordinator sent, according to its reports."""

    def __init__(self, chart: MachineChart) -> None:
        self.chart = chart
        self.tasks: dict[int, SentByCoordinator] = {}
        self.predictions: list[bool] = []
        """For each early activity that is decided: whether its state was entered."""
        self._late = Counter[WhyNotEarly]()
        self._last_report = CoordinationReport(-1)
        self._read = 0
        """The number of the coordinator's transitions that were read."""

    def label(self, state: int) -> str:
        """Return the label of a state; "" if there is no such state."""
        return self.chart.states[state].label if 0 <= state < len(self.chart.states) else ""

    def update(self, run: Run, coordinator: Task) -> None:
        """Read the reports that are new since the last update."""
        for change in coordinator.life[self._read :]:
            report = read_report(change.body) if change.effect is Effect.RESULT else None
            if report is not None:
                self._late.update(
                    why_not_early(self.chart, one)
                    for one in late_objections(self._last_report, report)
                )
                self._last_report = report
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

    def late_reasons(self) -> Counter[WhyNotEarly]:
        """Return the reasons why activities did not start early, counted.

        Reasons without a remedy are included only if no activity ran early.
        """
        has_early = any(task.is_early for task in self.tasks.values())
        return Counter(
            {why: times for why, times in self._late.items() if why.remedy or not has_early}
        )

    def _waste_rest(self, end: float) -> None:
        """Mark early work as wasted that is undecided when the coordinator ends."""
        rest = [task for task in self.tasks.values() if task.role() is TaskRole.AHEAD]
        self.predictions += [False] * len({task.state for task in rest})
        for task in rest:
            task.roles.append((end, TaskRole.WASTED))


def tasks_of_coordinator(run: Run, task: Task) -> CoordinatorTasks | None:
    """Return the tasks that a coordinator sent; None if the task is not a coordinator."""
    if not task.life:  # most tasks have no transitions
        return None
    key = CoordinatorTasks, task.id
    if key not in run.memo:
        known = run.formats.get(task.name)
        chart = read_machine(known.data, task.body) if known is not None else None
        run.memo[key] = (
            CoordinatorTasks(chart) if chart is not None and chart.is_coordinated else None
        )
    sent: CoordinatorTasks | None = run.memo[key]
    if sent is not None:
        sent.update(run, task)
    return sent


def sent_by_coordinator(run: Run, task: Task) -> SentByCoordinator | None:
    """Return what the parent's reports say of a task; None if no coordinator sent it."""
    parent = run.tasks.get(task.parent)
    sent = tasks_of_coordinator(run, parent) if parent is not None else None
    return sent.tasks.get(task.id) if sent is not None else None


def ends_waited_for(run: Run, handling: Handling) -> list[HandlerWait]:
    """Return a coordinator's waits for its tasks, except for wasted ones.

    The journal has no facts for such waits, since a coordinator waits for any event.
    """
    coordinator = run.tasks.get(handling.message_id)
    sent = tasks_of_coordinator(run, coordinator) if coordinator is not None else None
    known = sent.tasks.values() if sent is not None else ()
    tasks = [run.tasks[one.id] for one in known if not one.is_wasted]
    return [
        HandlerWait(
            task.id,
            task.received,
            Moment.END_ACHIEVING,
            task.time_of(Moment.END_ACHIEVING),
            handling,
        )
        for task in tasks
        if task.has_ended and task.by is handling
    ]


def coordinators(run: Run) -> Iterator[tuple[Task, CoordinatorTasks]]:
    """Yield the coordinators of a run with the tasks that they sent, oldest first."""
    for task in run.tasks.values():
        if (sent := tasks_of_coordinator(run, task)) is not None:
            yield task, sent


def work_span(run: Run, task: Task) -> tuple[float, float] | None:
    """Return the span from a task's first handling to its end; None if it was not handled."""
    if not task.handlings:
        return None
    return task.handlings[0].start, min(task.time_of(Moment.END_ACHIEVING), run.time)


class Gain(NamedTuple):
    """The gain and cost of a preview. Seconds of tasks that ran in parallel are added up."""

    right: int
    """The number of early activities whose states were entered."""
    wrong: int
    """The number of early activities whose states were not entered."""
    kept: float
    """Seconds that tasks ran before their states were entered: the time saved."""
    wasted: float
    """Seconds of early work for states that were not entered."""
    restored: float
    """Seconds of work to restore what wasted work had changed."""
    seconds: float
    """Seconds that the machine ran."""


def gains(run: Run) -> list[tuple[str, int, Gain, Counter[WhyNotEarly]]]:
    """Return each machine's name, number of runs, and total gain, and a count of the reasons why
    activities did not start early.
    """
    machines: dict[str, list[Gain]] = {}
    late: dict[str, Counter[WhyNotEarly]] = {}
    for task, sent in coordinators(run):
        machines.setdefault(sent.chart.name, []).append(gain(run, task, sent))
        late.setdefault(sent.chart.name, Counter()).update(sent.late_reasons())
    return [
        (machine, len(runs), Gain._make(map(sum, zip(*runs, strict=True))), late[machine])
        for machine, runs in machines.items()
    ]


def gain(run: Run, coordinator: Task, sent: CoordinatorTasks) -> Gain:
    """Return the gain of one run of a machine."""
    seconds = dict.fromkeys(TaskRole, 0.0)
    for one in sent.tasks.values():
        role, span = one.role(), work_span(run, run.tasks[one.id])
        if span is not None and role is not None:
            seconds[role] += max(min(span[1], one.entered) - span[0], 0.0)
    right, whole = sum(sent.predictions), work_span(run, coordinator)
    return Gain(
        right,
        len(sent.predictions) - right,
        seconds[TaskRole.KEPT],
        seconds[TaskRole.WASTED],
        seconds[TaskRole.RESTORING],
        whole[1] - whole[0] if whole else 0.0,
    )
