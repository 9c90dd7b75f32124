"""The errors of missions. All are TcaErrors.

UnknownTask is a NotOffered, and also an AttributeError. BadParameter is also a ValueError.
ConditionVerified is in conditions.py.
"""

from collections.abc import Sequence

from tca_behaviours.missions.outcomes import Status, TaskEnd
from tca_module.errors import TcaError


def describe_end(end: TaskEnd) -> str:
    """Describe the end of a task: "completed", "timeout: it ran for 2 s"."""
    status = Status.of(end.status).name.lower().replace("_", " ")
    return f"{status}: {end.text}" if end.text else status


class MissionTaskFailed(TcaError):
    """A task of a mission did not complete.

    *task* names it; *status* and *text* give the reason. *failure* is the name of the failure, or
    "" if the task was killed.
    """

    def __init__(self, task: str, end: TaskEnd, failure: str = "") -> None:
        super().__init__(f"{task}: {describe_end(end)}")
        self.task = task
        self.status = end.status
        self.text = end.text
        self.failure = failure


class NotOffered(TcaError):
    """No server offers the task, or none does any more."""


class UnknownTask(NotOffered, AttributeError):
    """The server offers no task of that name."""


class BadParameter(TcaError, ValueError):
    """A parameter of a task is unknown, missing, out of range, or of a wrong type. Nothing was
    sent.
    """


class StepUncertain(TcaError):
    """Step *step* was under way when the mission's process ended.

    *outcomes* has a pair for each task that the step had started. A pair consists of the task and
    its state, such as "completed", "is running" or "is unknown to central".
    """

    def __init__(self, step: str, outcomes: Sequence[tuple[str, str]]) -> None:
        tasks = ", ".join(f"{task} {outcome}" for task, outcome in outcomes)
        super().__init__(
            f"step '{step}' was under way when the mission's process ended "
            f"({tasks or 'it had started no task'}): repeat it with repeatable_step(), "
            f"or mark it as done with skip_step('{step}')"
        )
        self.step = step
        self.outcomes = list(outcomes)
