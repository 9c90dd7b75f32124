"""Conditions that interrupt a mission: ``mission.add_condition(ConditionIsCompleted(watch))``."""

from collections.abc import Callable, Collection, Sequence
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

from tca_behaviours.missions.client.errors import MissionTaskFailed
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.task_handle import TaskHandle, check_handles
from tca_behaviours.missions.outcomes import Status
from tca_module import Variable, checks
from tca_module.checks import check
from tca_module.errors import MisuseError, TcaError

D = TypeVar("D")
_UNSET: Any = object()
_STATUSES = checks.collection_of(
    "a list of statuses, such as [Status.TIMEOUT]", checks.instance_of("a Status", Status)
)


@runtime_checkable
class MissionCondition(Protocol):
    """An object that can interrupt a mission.

    While the mission waits, it calls ``is_verified()`` 20 times a second. So that method must not
    block. ``str()`` of the condition is the text of the exception.
    """

    def is_verified(self) -> bool:
        """Return whether the mission must be interrupted."""
        ...


CONDITION = checks.instance_of("an object with a method is_verified()", MissionCondition)


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
        check("ConditionIsCompleted", _STATUSES, ends=ends)
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


class ConditionIsRunning:
    """A condition that is verified while a task has not ended.

    Args:
        task: a task of this mission, or one of another that ``find_task`` has found.
        name: the text of the exception. Default: "TASK runs".

    Example::

        charge = station.find_task(24)
        mission.add_condition(NegatedCondition(ConditionIsRunning(charge)))
    """

    def __init__(self, task: TaskHandle, name: str = "") -> None:
        check_handles(task)
        self.task = task
        self.name = name or f"{task} runs"

    def __str__(self) -> str:
        return self.name

    def is_verified(self) -> bool:
        """Return whether the mission has not learned yet that the task ended."""
        return not self.task.is_known_over


class VariableCondition(Generic[D]):
    """A condition that is verified when the value of a variable of central passes a test.

    While the variable has no value, the condition is not verified. Central is asked for the value
    20 times a second.

    Args:
        variable: the Variable.
        test: a function of the value. It returns whether the condition is verified.
        name: the text of the exception. Default: "variable 'NAME' has passed its test".

    Example::

        mission.add_condition(VariableCondition(BATTERY, lambda level: level < 0.2, "battery low"))
    """

    def __init__(self, variable: Variable[D], test: Callable[[D], object], name: str = "") -> None:
        check("VariableCondition", checks.VARIABLE, variable=variable)
        check("VariableCondition", checks.FUNCTION, test=test)
        self.variable = variable
        self.test = test
        self.name = name or f"variable '{variable.name}' has passed its test"
        self._goal: MissionGoal | None = None

    def __str__(self) -> str:
        return self.name

    def attach(self, goal: MissionGoal) -> None:
        """Set the mission that asks central. ``add_condition`` calls it."""
        self._goal = goal

    def is_verified(self) -> bool:
        """Return whether the newest value passes the test.

        Raises:
            MisuseError: the condition was not added to a mission.
        """
        if self._goal is None:
            raise MisuseError(f"condition '{self}' has no mission: call add_condition() first")
        value = self._goal.sender.get_variable(self.variable, _UNSET)
        return value is not _UNSET and bool(self.test(value))


class NegatedCondition:
    """A condition that is verified when another one is not.

    Args:
        condition: the other condition.
        name: the text of the exception. Default: "not CONDITION".

    Example::

        mission.add_condition(NegatedCondition(ConditionIsRunning(watch), "the watch has ended"))
    """

    def __init__(self, condition: MissionCondition, name: str = "") -> None:
        check("NegatedCondition", CONDITION, condition=condition)
        self.condition = condition
        self.name = name or f"not {condition}"

    def __str__(self) -> str:
        return self.name

    def is_verified(self) -> bool:
        """Return whether the other condition is not verified now."""
        return not self.condition.is_verified()


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

    def add(self, condition: MissionCondition, goal: MissionGoal) -> None:
        """Add a condition."""
        if isinstance(one := _inner(condition), VariableCondition):
            one.attach(goal)
        self._conditions.append(condition)

    def living_tasks(self) -> list[TaskHandle]:
        """Return the tasks of conditions whose end the mission has not learned."""
        tasks = [task for condition in self._conditions for task in tasks_of(condition)]
        return [task for task in tasks if not task.is_known_over]

    def clear(self) -> list[TaskHandle]:
        """Remove all conditions. Return the tasks to stop."""
        conditions = map(_inner, self._conditions)
        tasks = [
            one.task
            for one in conditions
            if isinstance(one, ConditionIsCompleted) and one.stop_on_clear
        ]
        self._conditions.clear()
        return tasks

    def take_all_as_verified(self) -> ConditionVerified:
        """Remove all conditions. Return the exception that they are all verified."""
        verified = ConditionVerified(self._conditions)
        self._conditions.clear()
        return verified

    def check(self) -> bool:
        """Check whether a condition is verified, or its task has failed."""
        try:
            verified = list(filter(_is_verified, self._conditions))
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


def _is_verified(condition: MissionCondition) -> bool:
    try:
        return condition.is_verified()
    except Exception as error:
        error.add_note(f"The error comes from the condition '{condition}' of the mission.")
        raise


def tasks_of(condition: MissionCondition) -> list[TaskHandle]:
    """Return the task that a condition is about, if it is about one."""
    inner = _inner(condition)
    if isinstance(inner, ConditionIsCompleted | ConditionIsRunning):
        return [inner.task]
    return []


def _inner(condition: MissionCondition) -> MissionCondition:
    """Return the condition inside of negated ones."""
    while isinstance(condition, NegatedCondition):
        condition = condition.condition
    return condition
