"""What a mission can run into.

TcaError                (of the library)
├── MissionTaskFailed   a task failed, was interrupted, or took too long
├── ConditionVerified   a condition interrupted what the mission waited for (conditions.py)
├── NotOffered          no server offers such a task, or none does any more
│   └── UnknownTask     ... and there is no task of that name (also an AttributeError)
├── BadParameter        a parameter is unknown, missing, out of range, or of a wrong type (also a
ValueError) └── StepUncertain       whether a step was completed before the mission's process ended
is not known
"""

from collections.abc import Sequence

from tca_behaviours.missions.outcomes import Status, TaskEnd
from tca_module.errors import TcaError


def in_words(end: TaskEnd) -> str:
    """The end of a task for people: "completed", "timeout: it ran for 2 s"."""
    status = Status.of(end.status).name.lower().replace("_", " ")
    return f"{status}: {end.text}" if end.text else status


class MissionTaskFailed(TcaError):
    """A task of a mission did not complete: *task* names it, *status* and *text* say why; *failure*
    is the failure's name ("": it was killed).
    """

    def __init__(self, task: str, end: TaskEnd, failure: str = "") -> None:
        super().__init__(f"{task}: {in_words(end)}")
        self.task = task
        self.status = end.status
        self.text = end.text
        self.failure = failure


class NotOffered(TcaError):
    """No server offers such a task, or none does any more."""


class UnknownTask(NotOffered, AttributeError):
    """There is no task of that name."""


class BadParameter(TcaError, ValueError):
    """A parameter of a task is unknown, missing, out of range, or of a wrong type. Nothing was
    sent.
    """


class StepUncertain(TcaError):
    """Step *step* was under way when the mission's process ended. *outcomes* says of each task that
    it had begun what central knows: "done", "failed", "killed", "running" or "unknown".
    """

    def __init__(self, step: str, outcomes: Sequence[tuple[str, str]]) -> None:
        told = (
            ", ".join(f"{task} {outcome}" for task, outcome in outcomes) or "no task of it is known"
        )
        super().__init__(
            f"step '{step}' was under way when the mission's process ended ({told}): "
            f"do it again with repeatable_step(), or take it as done with skip_step('{step}')"
        )
        self.step = step
        self.outcomes = list(outcomes)
