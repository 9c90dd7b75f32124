"""Conditions that interrupt a mission: ``mission.add_condition(ConditionIsCompleted(watch))``."""

from collections.abc import Collection, Sequence
from typing import Protocol, runtime_checkable

from tca_behaviours.missions.client.task_handle import TaskHandle, check_handles
from tca_behaviours.missions.outcomes import Status
from tca_module.errors import TcaError


@runtime_checkable
class MissionCondition(Protocol):
    """An object that can interrupt a mission.

    While the mission waits, it calls ``is_verified()`` 20 times a second. So that method must not
    block. ``str()`` of the condition is the text of the exception.
    """

    def is_verified(self) -> bool:
        """Return whether the mission must be interrupted."""
        ...


class ConditionIsCompleted:
    """A condition that is verified when a task has completed, or has ended with an outcome in
    *ends*.

    If the task ends with any other outcome, the wait ends with the task's MissionTaskFailed.

    Args:
        task: the task, as ``mission.start(...)`` or a call with ``foreground=False`` returned it.
        name: the text of the exception. Default: "TASK has ended".
        ends: other outcomes that verify the condition, such as ``[Status.TIMEOUT]``.
        stop_on_clear: whether the task is stopped when the condition is cleared. Default: True.

    Example::

        rain = mission.WaitForRain(foreground=False)
        mission.add_condition(ConditionIsCompleted(rain, "it rains"))
    """

    def __init__(
        self,
        task: TaskHandle,
        name: str = "",
        *,
        ends: Collection[Status] = (),
        stop_on_clear: bool = True,
    ) -> None:
        check_handles(task)
        self.task = task
        self.name = name or f"{task} has ended"
        self.ends = {Status.COMPLETED, *ends}
        self.stop_on_clear = stop_on_clear

    def __str__(self) -> str:
        return self.name

    def is_verified(self) -> bool:
        """Return whether the mission has learned that the task ended with a verifying outcome.

        Raises:
            MissionTaskFailed: the task ended with another outcome.
        """
        if not self.task.is_known_over:
            return False
        end = self.task.end
        return (end is not None and Status.of(end.status) in self.ends) or bool(self.task.result())


class ConditionVerified(TcaError):
    """One or more conditions of a mission were verified.

    The conditions are cleared, and the task in the foreground has ended.
    """

    def __init__(self, conditions: Sequence[MissionCondition]) -> None:
        super().__init__("; ".join(map(str, conditions)))
        self.conditions = list(conditions)  #: the conditions that were verified
