"""Conditions that interrupt a mission: ``mission.add_condition(ConditionIsCompleted(watch))``."""

from collections.abc import Collection, Sequence
from typing import Protocol, runtime_checkable

from tca_behaviours.missions.client.task_handle import TaskHandle, check_handles
from tca_behaviours.missions.outcomes import Status
from tca_module.errors import TcaError


@runtime_checkable
class MissionCondition(Protocol):
    """Whatever can say that it is verified. Asked 20 times a second while the mission waits: it
    must not wait itself. ``str()`` of it is the text of the exception.
    """

    def is_verified(self) -> bool:
        """Whether the mission is to be interrupted."""
        ...


class ConditionIsCompleted:
    """Verified when a task has completed. A task that ends otherwise ends the wait with its
    MissionTaskFailed.

    *ends*: other ends that verify it, too, such as ``[Status.TIMEOUT]``. When the condition is
        cleared its task is
    stopped, unless *stop_on_clear* is False.
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
        """Whether the task has completed, as far as the mission has heard. Raises MissionTaskFailed
        if it can't.
        """
        if not self.task.is_known_over:
            return False
        end = self.task.end
        return (end is not None and Status.of(end.status) in self.ends) or bool(self.task.result())


class ConditionVerified(TcaError):
    """One or more conditions of a mission came true. They are cleared, and a task in the foreground
    has ended.
    """

    def __init__(self, conditions: Sequence[MissionCondition]) -> None:
        super().__init__("; ".join(map(str, conditions)))
        self.conditions = list(conditions)
