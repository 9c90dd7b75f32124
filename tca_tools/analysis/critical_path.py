"""The critical path: what a task waited for last, and what that waited for last, back to who
started it all. Pure.

The path has no gaps, so its steps add up to the time from its first to its last: making any of them
shorter is the only way to end sooner, and it helps until another path is the longest.
"""

from dataclasses import dataclass, field

from tca_tools.analysis.backwards import Causes, at_last
from tca_tools.analysis.step_words import named
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.analysis.summary import is_over, mattering
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import Moment


@dataclass(slots=True)
class CriticalPath:
    """The critical path of one task."""

    task: Task
    is_open: bool
    """Whether the task had not ended: then it leads to what went on last."""
    steps: list[PathStep]
    """Oldest first; each begins when the one before ends."""
    because: list[str] = field(default_factory=list)
    """Of an open one that leads to something outside of its task: the waits that lead there, in
    words.
    """

    @property
    def start(self) -> float:
        """When it begins."""
        return self.steps[0].start if self.steps else self.end

    @property
    def end(self) -> float:
        """When its task ended."""
        return self.steps[-1].end if self.steps else 0.0

    @property
    def seconds(self) -> float:
        """How long it is."""
        return self.end - self.start


@dataclass(slots=True)
class Share:
    """All steps of a path that have the same message, place and kind."""

    doing: Doing
    name: str
    """The message."""
    where: str
    steps: int
    seconds: float
    share: float
    """Of the whole path (0 to 1)."""


def last_task(run: Run) -> Task | None:
    """The top-level task that ended last; one that goes on, if there is one: the oldest. Monitors
    that stand by do not count, but what they have sent does.
    """
    top = mattering(run)
    living = next((task for task in top if not is_over(task)), None)
    return living or max(top, key=_end_of, default=None)


def longest_task(run: Run) -> Task | None:
    """The one of these that took longest."""
    top = mattering(run)
    return max(
        top,
        key=lambda task: (_end_of(task) if is_over(task) else run.time) - task.received,
        default=None,
    )


def critical_path(run: Run, causes: Causes, task: Task) -> CriticalPath:
    """The path to the end of *task*; if it has not ended, to what goes on in it."""
    if is_over(task):
        steps = list(causes.back_from(_end_of(task), task.id))
        return CriticalPath(task, False, steps[::-1])
    found, because = at_last(run, task)
    steps = [found.standing] if found.standing and found.standing.seconds > 0 else []
    since = found.standing.start if found.standing else run.time
    steps += causes.back_from(since, found.message_id, found.handling)
    return CriticalPath(task, True, steps[::-1], because)


def shares(run: Run, path: CriticalPath) -> list[Share]:
    """Where the path's time went, by message and place: the longest first."""
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
    end = task.reached.get(Moment.END_ACHIEVING)
    return end if end is not None else (task.stage(-1)[0] if task.states else task.received)
