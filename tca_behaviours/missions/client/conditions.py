"""Conditions that interrupt a mission: ``mission.add_condition(ConditionIsCompleted(watch))``."""

from collections.abc import Collection, Sequence
from typing import Protocol, runtime_checkable

from tca_behaviours.missions.client.errors import MissionTaskFailed
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


class ActiveConditions:
    """The conditions of a mission, and the exception with which they interrupt its next wait."""

    def __init__(self) -> None:
        self._conditions: list[MissionCondition] = []
        self._interruption: ConditionVerified | MissionTaskFailed | None = None

    @property
    def are_given(self) -> bool:
        """Whether there is at least one condition."""
        return bool(self._conditions)

    @property
    def has_interruption(self) -> bool:
        """Whether the last check found a condition verified, or its task failed."""
        return self._interruption is not None

    def add(self, condition: MissionCondition) -> None:
        """Add a condition."""
        self._conditions.append(condition)

    def clear(self) -> list[TaskHandle]:
        """Remove all conditions. Return the tasks to stop."""
        tasks = [
            condition.task
            for condition in self._conditions
            if isinstance(condition, ConditionIsCompleted) and condition.stop_on_clear
        ]
        self._conditions.clear()
        return tasks

    def check(self) -> bool:
        """Check whether a condition is verified, or its task has failed."""
        try:
            verified = [condition for condition in self._conditions if condition.is_verified()]
            self._interruption = ConditionVerified(verified) if verified else None
        except MissionTaskFailed as failed:
            self._interruption = failed
        return self.has_interruption

    def pop_interruption(self) -> ConditionVerified | MissionTaskFailed | None:
        """Return the exception that must interrupt the mission now; None if none must."""
        if self._interruption is None:
            self.check()
        interruption, self._interruption = self._interruption, None
        return interruption
