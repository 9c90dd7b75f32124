"""The critical path: the last cause of a task's end, the last cause of that cause, and so on. Pure.

The path has no gaps, so the durations of its steps add up to its whole duration. The task ends
sooner only if a step of the path is shortened. That helps until another path is longer.
"""

from dataclasses import dataclass, field

from tca_tools.analysis.backwards import Causes, cause_at_end
from tca_tools.analysis.step_words import named
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.analysis.summary import is_over, judged_tasks
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import Moment


@dataclass(slots=True)
class CriticalPath:
    """The critical path of one task."""

    task: Task
    is_open: bool
    """Whether the task had not ended. If so, the path leads to its last activity."""
    steps: list[PathStep]
    """The steps, oldest first; each starts when the one before ends."""
    because: list[str] = field(default_factory=list)
    """The waits, in words, that lead from an open task to a cause outside of its subtree."""

    @property
    def start(self) -> float:
        """When it starts."""
        return self.steps[0].start if self.steps else self.end

    @property
    def end(self) -> float:
        """When its task ended."""
        return self.steps[-1].end if self.steps else 0.0

    @property
    def seconds(self) -> float:
        """The duration."""
        return self.end - self.start


@dataclass(slots=True)
class Share:
    """All steps of a path with the same message, place and kind."""

    doing: Doing
    name: str
    """The message's name."""
    where: str
    steps: int
    seconds: float
    share: float
    """The share of the whole path (0 to 1)."""


def last_task(run: Run) -> Task | None:
    """Return the oldest top-level task that is open, else the one that ended last.

    A standby monitor does not count, but tasks that it sent do.
    """
    top = judged_tasks(run)
    still_open = next((task for task in top if not is_over(task)), None)
    return still_open or max(top, key=_end_of, default=None)


def longest_task(run: Run) -> Task | None:
    """Return the top-level task that took longest."""

    def seconds(task: Task) -> float:
        return (_end_of(task) if is_over(task) else run.time) - task.received

    return max(judged_tasks(run), key=seconds, default=None)


def critical_path(run: Run, causes: Causes, task: Task) -> CriticalPath:
    """Return the path to the end of *task*, or to its current activity if it has not ended."""
    if is_over(task):
        steps = list(causes.back_from(_end_of(task), task.id))
        return CriticalPath(task, False, steps[::-1])
    cause, because = cause_at_end(run, task)
    last = cause.standstill
    steps = [last] if last and last.seconds > 0 else []
    since = last.start if last else run.time
    steps += causes.back_from(since, cause.message_id, cause.handling)
    return CriticalPath(task, True, steps[::-1], because)


def shares(run: Run, path: CriticalPath) -> list[Share]:
    """Return the path's time by message, place and kind, the longest first."""
    found: dict[tuple[Doing, str, str], Share] = {}
    for step in path.steps:
        name, where = named(run, step.message_id), step.where
        if step.doing is Doing.OUTSIDE:
            name = ""
        share = found.setdefault(
            (step.doing, name, where), Share(step.doing, name, where, 0, 0.0, 0.0)
        )
        share.steps += 1
        share.seconds += step.seconds
    for share in found.values():
        share.share = share.seconds / path.seconds if path.seconds > 0 else 0.0
    return sorted(found.values(), key=lambda share: -share.seconds)


def _end_of(task: Task) -> float:
    if (end := task.reached.get(Moment.END_ACHIEVING)) is not None:
        return end
    return task.stage(-1)[0] if task.states else task.received
