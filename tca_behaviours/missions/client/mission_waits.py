"""The waits of a mission for its tasks, and the conditions that interrupt them."""

import time
from collections.abc import Sequence

from tca_behaviours.missions.client.conditions import CONDITION, MissionCondition, tasks_of
from tca_behaviours.missions.client.mission_tasks import MissionTasks
from tca_behaviours.missions.client.task_handle import TaskHandle, check_handles
from tca_behaviours.missions.outcomes import TaskEnd
from tca_module import CentralLost, MisuseError, Timeout, checks
from tca_module.checks import check

_TASKS = checks.instance_of("a list of started tasks, such as [watch, drive]", list | tuple)


class MissionWaits:
    """The part of a mission that waits for tasks which have been started."""

    _tasks: MissionTasks
    _is_open = False

    def _check_open(self) -> None:
        if not self._is_open:
            raise MisuseError(
                "the mission is not open: use it inside 'with Mission(...) as mission:'"
            )

    def finish(self, task: TaskHandle) -> TaskEnd:
        """Wait for the end of a task, and stop the task if the wait is interrupted.

        Args:
            task: a task of this mission.

        Returns:
            The TaskEnd of the completed task.

        Raises:
            MissionTaskFailed: the task did not complete.
            ConditionVerified: a condition was verified; the task has been stopped.
        """
        self._wait_or_stop(task)
        return task.result()

    def _wait_or_stop(self, task: TaskHandle) -> None:
        """Wait for the end of a foreground task, and stop it if the wait ends with an error."""
        try:
            self._tasks.wait([task], None, in_foreground=[task])
        except CentralLost:
            raise  # without central no task can be stopped
        except BaseException as error:
            self._tasks.stopping.stop_after(error, [task], "the mission was interrupted")
            raise

    def wait_for_task(self, task: TaskHandle, timeout: float | None = None) -> TaskEnd:
        """Wait until a task has ended.

        Args:
            task: a task of this mission.
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The TaskEnd of the completed task.

        Raises:
            MissionTaskFailed: the task did not complete.
            Timeout: the task did not end in time; it runs on.
            ConditionVerified: a condition was verified.
            TaskKilled: the mission was killed.
        """
        self.wait_for_any_task([task], timeout)
        return task.result()

    def wait_for_any_task(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> TaskHandle:
        """Wait until one of the tasks has ended.

        Args:
            tasks: the tasks, one or more.
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The task that has ended.

        Raises:
            MissionTaskFailed, Timeout, ConditionVerified, TaskKilled: as for ``wait_for_task``.
        """
        ended = self.first_ended(tasks, timeout)
        if not ended:
            names = ", ".join(map(str, tasks))
            raise Timeout(f"{names} did not end within {timeout:g} s", can_wait=True)
        ended[0].result()
        return ended[0]

    def wait_for_all_tasks(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> list[TaskEnd]:
        """Wait until all of the tasks have ended.

        Args:
            tasks: the tasks, one or more.
            timeout: the most seconds to wait for all of them. Default: None, no bound.

        Returns:
            The TaskEnd of each completed task, in the order of *tasks*.

        Raises:
            MissionTaskFailed: a task did not complete; raised as soon as the first one did not.
            Timeout, ConditionVerified, TaskKilled: as for ``wait_for_task``.
        """
        self._check_wait(tasks, timeout)
        until = None if timeout is None else time.monotonic() + timeout
        remaining = list(tasks)
        while remaining:
            ended = self.wait_for_any_task(
                remaining, None if until is None else max(0.0, until - time.monotonic())
            )
            remaining.remove(ended)
        return [task.result() for task in tasks]

    def first_ended(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> list[TaskHandle]:
        """Wait until at least one of the tasks has ended.

        Unlike ``wait_for_any_task`` it raises nothing for a task that failed: see its ``end``.

        Args:
            tasks: the tasks, one or more.
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            All of the tasks that have ended; [] if none did within *timeout* seconds.

        Raises:
            ConditionVerified, TaskKilled: as for ``wait_for_task``.
        """
        self._check_open()
        self._check_wait(tasks, timeout)
        if not tasks:
            raise MisuseError("there is no task to wait for: give at least one")
        return self._tasks.wait(tasks, timeout)

    def _check_wait(self, tasks: Sequence[TaskHandle], timeout: float | None) -> None:
        check("the wait for tasks", checks.TIMEOUT, timeout=timeout)
        check("the wait for tasks", _TASKS, tasks=tasks)
        check_handles(*tasks, owner=self._tasks)

    # --- conditions -------------------------------------------------------------------------------

    def add_condition(self, condition: MissionCondition) -> None:
        """Interrupt the mission's waits when a condition is verified.

        The wait then raises ConditionVerified, or MissionTaskFailed if the condition's task failed.

        Args:
            condition: a ConditionIsCompleted, ConditionIsRunning, VariableCondition or
                NegatedCondition, or any object with a method ``is_verified()``.
        """
        check("add_condition()", CONDITION, condition=condition)
        check_handles(*tasks_of(condition), owner=self._tasks)
        self._tasks.conditions.add(condition, self._tasks.goal)

    def clear_conditions(self) -> None:
        """Remove all conditions. Stop their tasks, except with ``stop_on_clear=False``, and wait
        until these tasks end.

        Raises:
            Timeout: a task did not end within 10 seconds.
        """
        self._tasks.clear_conditions()
