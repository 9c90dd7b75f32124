"""The summary of a run: one sentence and a few numbers."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

from tca_tools.journal.fates import STANDINGS, standing
from tca_tools.journal.records import OVER, Restart, Task, TaskState
from tca_tools.journal.whole_run import Run
from tca_wire.text.measures import counted, run_time
from tca_wire.text.printable import first_line
from tca_wire.vocabulary import CENTRAL

ENDED_BADLY = (TaskState.FAILED, TaskState.KILLED)
"""States of an ended task whose successors could not continue as planned."""
_LONGEST = 200
"""The longest reason, in characters."""


@dataclass(frozen=True)
class Summary:
    """A run at a glance."""

    began: float | None
    """The wall-clock time (seconds since 1970) at which the entries' clock was 0."""
    start: float
    """When the first task was sent, else the first message, in seconds since the run started. A
    standby monitor does not count.
    """
    end: float
    """When the last task ended, else the end of the journal or the present of a live run. Shares in
    a report are shares of the time from ``start`` to ``end``.
    """
    is_live: bool
    """Whether the run has not ended."""
    now: float
    """The time until which the run is known."""
    modules: int
    """The number of modules that handled, offered, sent or locked something."""
    messages: int
    tasks: dict[str, int]
    """The number of tasks by standing at the end."""
    top: int
    """The number of top-level tasks, without standby monitors."""
    failures: int
    """The number of failures raised on tasks and other messages."""
    reasons: list[tuple[str, int]]
    """Why top-level tasks were not achieved: an example and the number for each kind of reason."""
    dropped: list[tuple[str, int]]
    """The number of lost messages by name, the largest first."""
    is_good: bool
    """Whether every top-level task was achieved."""
    outcome: str
    """The outcome in one sentence."""
    restarts: Sequence[Restart] = ()
    """The restarts of central."""

    @property
    def seconds(self) -> float:
        """The duration from ``start`` to ``end``."""
        return max(self.end - self.start, 0.0)


def summary(run: Run) -> Summary:
    """Return the summary of a run."""
    counts = Counter(standing(run, task, task.state) for task in run.tasks.values())
    top = [task for task in map(run.tasks.__getitem__, run.top) if not is_standby_monitor(task)]
    failures = sum(len(message.failures) for message in run.messages.values())
    start, end = span_of(run)
    return Summary(
        run.began,
        start,
        end,
        run.is_live,
        run.time,
        len(_active_modules(run)),
        len(run.messages),
        {one: counts[one] for one in STANDINGS if counts[one]},
        len(top),
        failures,
        _reasons(run, top),
        _dropped(run),
        bool(top) and all(task.state is TaskState.ACHIEVED for task in top),
        _outcome(run, top, failures),
        run.restarts,
    )


def _dropped(run: Run) -> list[tuple[str, int]]:
    return Counter(drop.name for drop in run.drops if drop.is_loss).most_common()


def _active_modules(run: Run) -> set[str]:
    offering = {name for name, module in run.modules.items() if module.resources}
    senders = {message.sender for message in run.messages.values() if not message.role}
    claiming = {claim.sender for claim in run.claims.values()}
    running = {handling.module for handling in run.handlings}
    return (offering | senders | claiming | running) & run.modules.keys()


def span_of(run: Run) -> tuple[float, float]:
    """Return when the first task was sent and when the last one ended, or the end of the journal.

    A standby monitor does not count, but tasks that it sent do.
    """
    if not run.tasks:
        first = next(iter(run.messages.values()), None)
        return (first.received if first else run.time), run.time
    top = judged_tasks(run)
    ends = (task.stage(-1)[0] if is_over(task) else run.time for task in top)
    return min(task.received for task in top), max(ends)


def judged_tasks(run: Run) -> list[Task]:
    """Return the tasks by which a run is judged, oldest first: the top-level tasks.

    A standby monitor is replaced by the tasks that it sent, unless there are only such monitors.
    """
    found, walked = [], list(run.top)
    for number in walked:  # the list grows during the loop
        task = run.tasks[number]
        if is_standby_monitor(task):
            walked += task.children
        else:
            found.append(task)
    found = found or [run.tasks[number] for number in run.top]
    return sorted(found, key=attrgetter("id"))


def is_standby_monitor(task: Task) -> bool:
    """Whether a task is a monitor without an end of its own: open, or killed by a module."""
    if not task.message_class.is_monitor:
        return False
    return not is_over(task) or (task.state is TaskState.KILLED and task.killed_by != CENTRAL)


def is_over(task: Task) -> bool:
    """Whether a task has ended."""
    return task.state in OVER


def _outcome(run: Run, top: list[Task], failures: int) -> str:
    """Return the outcome: how many tasks were achieved, were not, or are open, and a reason."""
    if not run.top:
        return "No task was sent."
    bad = [task for task in top if task.state in ENDED_BADLY]
    living = sum(not is_over(task) for task in top)
    parts = [] if top else ["No top-level task other than monitors was sent"]
    if top and not bad and not living:
        after = f", after {counted(failures, 'failure')} on the way" if failures else ""
        resolved = sum(task.state is TaskState.RESOLVED for task in top)
        if achieved := len(top) - resolved:
            parts.append(f"{_count_in_words(achieved, top)} achieved{after}")
        if resolved:
            parts.append(f"{_count_in_words(resolved, top)} {TaskState.RESOLVED}")
    if bad:
        first = "first " if len(bad) > 1 else ""
        parts.append(
            f"{_count_in_words(len(bad), top)} not achieved: {first}{_end_in_words(bad[0])}"
        )
    if living:
        still = "not over when the journal ended"
        if run.is_live:
            still = f"still running, as of {run_time(run.time)}"
        parts.append(f"{_count_in_words(living, top, is_now=run.is_live)} {still}")
    monitors = [task for task in map(run.tasks.__getitem__, run.top) if is_standby_monitor(task)]
    if watching := sum(not is_over(task) for task in monitors):
        how = "watching" if run.is_live else "watched"
        parts.append(f"{counted(watching, 'monitor')} still {how}")
    return "; ".join(parts) + "."


def _count_in_words(number: int, top: list[Task], *, is_now: bool = False) -> str:
    """Return ``The top-level task was`` or ``2 of 3 top-level tasks were``."""
    singular, plural = ("is", "are") if is_now else ("was", "were")
    if len(top) == 1:
        return f"The top-level task {singular}"
    return f"{number:,} of {len(top):,} top-level tasks {singular if number == 1 else plural}"


def _reasons(run: Run, top: list[Task]) -> list[tuple[str, int]]:
    found: dict[object, list[Task]] = {}
    for task in top:
        if task.state in ENDED_BADLY:
            failed = task if task.failure else run.tasks.get(task.killed_for, task)
            why = failed.failure.name if failed.failure else task.killed
            found.setdefault((task.name, task.state, why), []).append(task)
    rows = [(_end_in_words(tasks[0]), len(tasks)) for tasks in found.values()]
    return sorted(rows, key=lambda row: -row[1])


def _end_in_words(task: Task) -> str:
    """Return a task that was not achieved and the reason: ``move {5} failed: jam``."""
    how = f"was killed: {task.why_killed or 'no reason given'}"
    if task.state is TaskState.FAILED:
        how = f"failed: {task.failure or task.why_killed}"
    text = first_line(f"{task} {how}")
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"
