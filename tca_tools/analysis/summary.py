"""How a run went, in one sentence and a few numbers."""

from collections import Counter
from dataclasses import dataclass
from operator import attrgetter

from tca_tools.journal.fates import STANDINGS, standing
from tca_tools.journal.records import OVER, Task, TaskState
from tca_tools.journal.whole_run import Run
from tca_wire.text.measures import counted, run_time
from tca_wire.text.printable import first_line
from tca_wire.vocabulary import CENTRAL

ENDED_BADLY = (TaskState.FAILED, TaskState.KILLED)
"""States of a task that has ended and did not let what follows it go on as planned."""
_LONGEST = 200
"""Characters of a reason."""


@dataclass(frozen=True)
class Summary:
    """A run at a glance."""

    began: float | None
    """Wall-clock time (seconds since 1970) of the entries' 0."""
    start: float
    """When the first task (or else message) was sent, in seconds since the run began; not a monitor
    that stands by.
    """
    end: float
    """When the last task ended, or else the journal (of a live run: the present); the time between
    is what the shares in a report are of.
    """
    is_live: bool
    """Whether the run goes on."""
    now: float
    """Until when is known what happened."""
    modules: int
    """Those that handled, offered, sent or locked something: who only asks what there is does not
    count.
    """
    messages: int
    tasks: dict[str, int]
    """How many tasks stand how at the end, in words, those that occur."""
    top: int
    """How many top-level tasks there are, without monitors that watch until somebody ends them."""
    failures: int
    """How many failures were raised on tasks and other messages."""
    reasons: list[tuple[str, int]]
    """Why top-level tasks were not achieved: the first of those with a like reason, in words, and
    how many they are.
    """
    dropped: list[tuple[str, int]]
    """How many messages of each name were lost on the way to a handler, most first."""
    is_good: bool
    """Whether every top-level task was achieved."""
    outcome: str

    @property
    def seconds(self) -> float:
        """How long the tasks took."""
        return max(self.end - self.start, 0.0)


def summary(run: Run) -> Summary:
    """The summary of the whole run."""
    counts = Counter(standing(run, task, task.state) for task in run.tasks.values())
    top = [task for task in map(run.tasks.__getitem__, run.top) if not stands_by(task)]
    failures = sum(len(message.failures) for message in run.messages.values())
    start, end = span_of(run)
    return Summary(
        run.began,
        start,
        end,
        run.is_live,
        run.time,
        len(_working(run)),
        len(run.messages),
        {one: counts[one] for one in STANDINGS if counts[one]},
        len(top),
        failures,
        _reasons(run, top),
        _dropped(run),
        bool(top) and all(task.state is TaskState.ACHIEVED for task in top),
        _outcome(run, top, failures),
    )


def _dropped(run: Run) -> list[tuple[str, int]]:
    lost: Counter[str] = Counter()
    for drop in run.drops:
        lost[drop.name] += drop.number * (drop.is_loss and bool(drop.name))
    return [(name, number) for name, number in lost.most_common() if number]


def _working(run: Run) -> set[str]:
    offering = {name for name, module in run.modules.items() if module.resources}
    senders = {message.sender for message in run.messages.values() if not message.role}
    claiming = {claim.sender for claim in run.claims.values()}
    running = {handling.module for handling in run.handlings}
    running |= {handling.direct_from for handling in run.handlings}
    return (offering | senders | claiming | running) & run.modules.keys()


def span_of(run: Run) -> tuple[float, float]:
    """From the first task sent until the last one ended; if one goes on, until the journal's end. A
    monitor that stands by is not one of them, what it sends is.
    """
    if not run.tasks:
        first = next(iter(run.messages.values()), None)
        return (first.received if first else run.time), run.time
    top = mattering(run)
    ends = (task.stage(-1)[0] if is_over(task) else run.time for task in top)
    return min(task.received for task in top), max(ends)


def mattering(run: Run) -> list[Task]:
    """The tasks by which a run is judged, oldest first: those at the top; instead of monitors that
    stand by, what these have sent. Where there is nothing else, the monitors.
    """
    found, walked = [], list(run.top)
    for number in walked:  # grows while it is walked
        task = run.tasks[number]
        if stands_by(task):
            walked += task.children
        else:
            found.append(task)
    found = found or [run.tasks[number] for number in run.top]
    return sorted(found, key=attrgetter("id"))


def stands_by(task: Task) -> bool:
    """Whether it is a monitor that watches until somebody ends it: it still does, or a module has
    killed it.
    """
    if not task.message_class.is_monitor:
        return False
    return not is_over(task) or (task.state is TaskState.KILLED and task.killed_by != CENTRAL)


def is_over(task: Task) -> bool:
    """Whether a task has ended."""
    return task.state in OVER


def _outcome(run: Run, top: list[Task], failures: int) -> str:
    """One sentence: good, bad or not over, and the first reason; monitors that go on apart."""
    if not run.top:
        return "No task was sent."
    bad = [task for task in top if task.state in ENDED_BADLY]
    living = sum(not is_over(task) for task in top)
    parts = [] if top else ["No top-level task but monitors was sent"]
    if top and not bad and not living:
        after = f", after {counted(failures, 'failure')} on the way" if failures else ""
        resolved = sum(task.state is TaskState.RESOLVED for task in top)
        if achieved := len(top) - resolved:
            parts.append(f"{_some(achieved, top)} achieved{after}")
        if resolved:
            parts.append(f"{_some(resolved, top)} {TaskState.RESOLVED}")
    if bad:
        first = "first " if len(bad) > 1 else ""
        parts.append(f"{_some(len(bad), top)} not achieved: {first}{_ended(bad[0])}")
    if living:
        still = "not over when the journal ended"
        if run.is_live:
            still = f"still running, as of {run_time(run.time)}"
        parts.append(f"{_some(living, top, is_now=run.is_live)} {still}")
    monitors = [task for task in map(run.tasks.__getitem__, run.top) if stands_by(task)]
    if watching := sum(not is_over(task) for task in monitors):
        how = "watching" if run.is_live else "watched"
        parts.append(f"{counted(watching, 'monitor')} still {how}")
    return "; ".join(parts) + "."


def _some(number: int, top: list[Task], *, is_now: bool = False) -> str:
    """``The top-level task was``, ``2 of 3 top-level tasks were``."""
    verb = ("is" if is_now else "was") if number == 1 else ("are" if is_now else "were")
    if len(top) == 1:
        return f"The top-level task {verb}"
    return f"{number:,} of {len(top):,} top-level tasks {verb}"


def _reasons(run: Run, top: list[Task]) -> list[tuple[str, int]]:
    found: dict[object, list[Task]] = {}
    for task in top:
        if task.state in ENDED_BADLY:
            failed = task
            if task.state is TaskState.KILLED:
                failed = run.tasks.get(task.killed_for, task)
            why = failed.failure.name if failed.failure else task.killed
            found.setdefault((task.name, task.state, why), []).append(task)
    rows = [(_ended(tasks[0]), len(tasks)) for tasks in found.values()]
    return sorted(rows, key=lambda row: -row[1])


def _ended(task: Task) -> str:
    """``move {5} failed: jam``: a task that was not achieved, and why."""
    how = f"was killed: {task.why_killed or 'nobody said why'}"
    if task.state is TaskState.FAILED:
        how = f"failed: {task.failure}"
    text = first_line(f"{task} {how}")
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"
