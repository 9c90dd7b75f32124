"""Conditions that interrupt a mission: ``mission.add_condition(ConditionIsCompleted(watch))``."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from tca_missions.client.task_handle import TaskHandle, check_handles
from tca_module.errors import TcaError


@runtime_checkable
class MissionCondition(Protocol):
    """Whatever can say that it is verified. Asked 20 times a second while the mission waits: it must not wait itself.
    ``str()`` of it is the text of the exception.
    """

    def is_verified(self) -> bool:
        """Whether the mission is to be interrupted."""
        ...


class ConditionIsCompleted:
    """Verified when a task has ended, however it ended."""

    def __init__(self, task: TaskHandle, name: str = "") -> None:
        check_handles(task)
        self.task = task
        self.name = name or f"{task} has ended"

    def __str__(self) -> str:
        return self.name

    def is_verified(self) -> bool:
        """Whether the task has ended, as far as the mission has heard."""
        return self.task.is_known_over


class ConditionVerified(TcaError):
    """One or more conditions of a mission came true. They are cleared, and a task in the foreground has ended."""

    def __init__(self, conditions: Sequence[MissionCondition]) -> None:
        super().__init__("; ".join(map(str, conditions)))
        self.conditions = list(conditions)
