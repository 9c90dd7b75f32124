"""The tasks that a mission has started, and the waits for their ends.

A mission and the missions beside it share one object of this class. So one wait may be for tasks of
several servers, and all servers' tasks are interrupted by the same conditions.
"""

import math
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from tca_behaviours.missions.client.conditions import ActiveConditions
from tca_behaviours.missions.client.dry_run import CheckedTask, DryRun
from tca_behaviours.missions.client.errors import NotOffered
from tca_behaviours.missions.client.lost_handlers import LostHandlers
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.steps import Steps
from tca_behaviours.missions.client.stopping import CHECK_PERIOD, Stopping
from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_module import Command
from tca_module.sending.any_task import first_ended

_MOST_ENDED = 10  # the number of ended tasks that a mission remembers


class MissionTasks:
    """The started tasks of a mission, with its goal, its conditions and its steps."""

    def __init__(self, goal: MissionGoal, name: str, dry_run: DryRun | None) -> None:
        self.goal = goal
        self.name = name
        self.dry_run = dry_run  #: None if tasks are sent
        self.steps: Steps | None = None
        self.stopping = Stopping(name)
        self.conditions = ActiveConditions()
        self.running: dict[int, TaskHandle] = {}
        self.ended = deque[TaskHandle](maxlen=_MOST_ENDED)  #: the last ended tasks, oldest first
        self._lost_handlers = LostHandlers(goal)

    def start(self, command: Command[Any, Any], data: Any, name: str) -> TaskHandle:
        """Start a command as a task. Raises NotOffered, ConditionVerified."""
        if self.dry_run is not None:
            self.dry_run.count_call(self.conditions)
            return CheckedTask(name, self)
        self.goal.raise_if_killed()
        if self.conditions.are_given:
            for running in [*self.running.values(), *self.conditions.living_tasks()]:
                running.end  # noqa: B018 - learn of its end now, before the new task begins
            self.raise_interruption()
        below = self.goal.below()
        with below.parallel():  # only the program orders the tasks of a mission
            sent = below.execute_if_handled(command, data)
        if sent is None:
            raise NotOffered(f"no server offers {command.name} any more: start its server")
        handle = TaskHandle(name, sent, self)
        self.running[handle.id] = handle
        if self.steps is not None:
            self.steps.record_task(handle)
        return handle

    def wait(
        self,
        tasks: Sequence[TaskHandle],
        timeout: float | None,
        *,
        in_foreground: Sequence[TaskHandle] = (),
    ) -> list[TaskHandle]:
        """Wait until one of the tasks has ended, or an event ends the wait with an exception."""
        until = math.inf if timeout is None else time.monotonic() + timeout
        while not (ended := [task for task in tasks if task.is_known_over]):
            self.raise_interruption(in_foreground)
            remaining = until - time.monotonic()
            if remaining <= 0:
                return [task for task in tasks if task.is_over]
            if not self._wait_for_event(tasks, min(remaining, CHECK_PERIOD)):
                self.stopping.warn_of_hung(tasks)
        self.goal.raise_if_killed(ask=any(task.is_interrupted for task in ended))
        return ended

    def _wait_for_event(self, tasks: Sequence[TaskHandle], timeout: float) -> bool:
        """Wait for an event that may end a wait for *tasks*; False if there was none in time."""
        others = [*self.running.values(), *self.conditions.living_tasks()]
        awaited = {task.sent: task for task in [*tasks, *others]}
        ended = first_ended(
            list(awaited),
            timeout,
            lambda: self.conditions.check() or self._lost_handlers.newly_lost(tasks),
            # A condition or a short timeout will end this wait, so it is no deadlock.
            brief=self.conditions.are_given or timeout < CHECK_PERIOD,
        )
        for sent in ended:
            awaited[sent].record_end()  # type: ignore[index]
        self._lost_handlers.check(tasks)
        return bool(ended) or self.conditions.has_interruption

    def on_task_end(self, task: TaskHandle) -> None:
        """Forget a task that has ended."""
        self._lost_handlers.forget(task)
        self.stopping.forget(task)
        if self.running.pop(task.id, None) is not None:
            self.ended.append(task)

    def clear_conditions(self) -> None:
        """Remove all conditions, and stop their tasks. Tasks of other missions run on."""
        own = [task for task in self.conditions.clear() if task.id in self.running]
        self.stopping.stop(own, "its condition was cleared")

    def raise_interruption(self, in_foreground: Sequence[TaskHandle] = ()) -> None:
        """Raise the exception of a condition that interrupts the mission, if one does."""
        interruption = self.conditions.pop_interruption()
        if interruption is None:
            return
        for task in in_foreground:  # stop it now, not after the conditions' tasks
            task.stop("the mission was interrupted")
        self.clear_conditions()
        raise interruption
