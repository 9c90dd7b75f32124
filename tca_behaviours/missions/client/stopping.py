"""Stops the tasks of a mission, waits for that, and names those that do not end."""

import time
from collections.abc import Sequence

from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_module import Timeout, wait_for_any
from tca_module.log import log_of

LOOKS_EVERY = 2.0  # seconds between two looks at the tasks that a mission waits for
_PATIENCE = 2.0  # seconds that a stopped task is waited for without a word
_STOPS_WITHIN = 10.0  # seconds that a stopped task may take to leave things safe


class Stopping:
    """What a mission knows of its tasks that are to end."""

    def __init__(self, mission: str) -> None:
        self.hung: dict[int, TaskHandle] = {}  #: those that were waited for in vain
        self._log = log_of(f"mission {mission}")
        self._ending: dict[int, float] = {}  # are to end, as was first seen at that time
        self._said = set[int]()

    def stop(self, tasks: Sequence[TaskHandle], why: str) -> None:
        """Stop tasks, and wait until they have left things safe. Raises Timeout."""
        left = _wait([task for task in tasks if task.stop(why)], _PATIENCE)
        self._say(left, "was stopped")
        if left := _wait(left, _STOPS_WITHIN - _PATIENCE):
            self._give_up(left)
            raise Timeout(f"{_names(left)} did not end within {_STOPS_WITHIN:g} s of being stopped")

    def stop_after(self, error: BaseException, tasks: Sequence[TaskHandle], why: str) -> None:
        """Stop tasks because of *error*, which the mission raises then. After Ctrl-C another one
        ends the wait; that a task does not end is no error then, but a line of the log.
        """
        if not isinstance(error, KeyboardInterrupt):
            self.stop(tasks, why)
            return
        try:
            self.stop(tasks, why)
        except KeyboardInterrupt:
            self._give_up(tasks)
            raise
        except Timeout as late:
            self._log.warning("%s", late)

    def end(self, tasks: Sequence[TaskHandle], why: str) -> None:
        """Stop all that runs: the mission has ended. What was waited for in vain is not waited for
        again.
        """
        try:
            if self.hung:
                for task in tasks:
                    task.stop(why)
            else:
                self.stop(tasks, why)
        except KeyboardInterrupt:
            self._give_up(tasks)
            raise
        finally:
            if self.hung and (left := _not_over(tasks)):
                self._log.warning(
                    "the mission ends, and does not wait any more for %s: still running",
                    _names(left),
                )

    def look(self, tasks: Sequence[TaskHandle]) -> None:
        """Say of tasks that the mission waits for that they are to end, and do not."""
        for task in tasks:
            if task.id in self._said or task.is_known_over or (info := task.sent.info()) is None:
                continue
            if not (info.killed or info.failure):
                self._ending.pop(task.id, None)
            elif time.monotonic() >= self._ending.setdefault(task.id, time.monotonic()) + _PATIENCE:
                self._say([task], "has failed" if info.failure else "was stopped")

    def forget(self, task: TaskHandle) -> None:
        """It has ended."""
        self.hung.pop(task.id, None)
        self._ending.pop(task.id, None)
        self._said.discard(task.id)

    def _say(self, tasks: Sequence[TaskHandle], what: str) -> None:
        for task in tasks:
            self._said.add(task.id)
            self._log.warning("waits for %s, which %s and does not return", task, what)

    def _give_up(self, tasks: Sequence[TaskHandle]) -> None:
        self.hung |= {task.id: task for task in _not_over(tasks)}


def _wait(tasks: Sequence[TaskHandle], seconds: float) -> list[TaskHandle]:
    """Wait until all have ended, at most so long; those that have not."""
    until = time.monotonic() + seconds
    while left := _not_over(tasks):
        ended = wait_for_any([task.sent for task in left], max(0.0, until - time.monotonic()))
        if not ended:
            return left
        for task in left:
            if task.sent in ended:
                task.note_end()
    return []


def _not_over(tasks: Sequence[TaskHandle]) -> list[TaskHandle]:
    return [task for task in tasks if not task.is_known_over]


def _names(tasks: Sequence[TaskHandle]) -> str:
    return ", ".join(map(str, tasks))
