"""Ends a mission's wait for a task that has lost its last handler before it began."""

from collections.abc import Sequence

from tca_behaviours.missions.client.errors import NotOffered
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.task_handle import TaskHandle


class LostHandlers:
    """Finds the awaited tasks of a mission whose message has lost its last handler."""

    def __init__(self, goal: MissionGoal) -> None:
        self._goal = goal
        self._checked_at: dict[int, int] = {}  # by task: the count of handler changes at its check

    def newly_lost(self, tasks: Sequence[TaskHandle]) -> list[TaskHandle]:
        """Return the unchecked tasks whose message has lost its last handler."""
        return [
            task
            for task in tasks
            if task.sent.message in self._goal.lost_messages
            and not task.is_known_over
            and self._checked_at.get(task.id) != self._goal.handler_changes
        ]

    def check(self, tasks: Sequence[TaskHandle]) -> None:
        """Stop the first newly lost task that has not begun, and raise NotOffered.

        A task that had begun is about to fail. A task that had not would wait for ever.
        """
        for task in self.newly_lost(tasks):
            self._checked_at[task.id] = self._goal.handler_changes
            info = task.sent.info()
            if info is not None and not (info.module or info.failure):
                why = f"no server offers {task.sent.message} any more"
                task.stop(why)
                raise NotOffered(f"{why}, and {task} waited for it: start its server")

    def forget(self, task: TaskHandle) -> None:
        """Remove the record of a task that has ended."""
        self._checked_at.pop(task.id, None)
