"""Stops the tasks of a mission, waits for their ends, and warns of tasks that hang."""

import time
from collections.abc import Sequence

from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_module import Timeout, wait_for_any
from tca_module.log import log_of

CHECK_PERIOD = 2.0  # seconds between two checks of the tasks that a mission waits for
_PATIENCE = 2.0  # seconds that a stopped task may take before the mission warns
_STOPS_WITHIN = 10.0  # seconds that a stopped task may take to terminate


class Stopping:
    """Stops the tasks of a mission, and remembers those that hang."""

    def __init__(self, mission: str) -> None:
        self.hung: dict[int, TaskHandle] = {}  #: tasks that did not end in time
        self._log = log_of(f"mission {mission}")
        self._stopped_since: dict[int, float] = {}  # by task: when first seen stopped or failed
        self._warned = set[int]()

    def stop(self, tasks: Sequence[TaskHandle], why: str) -> None:
        """Stop tasks, and wait until they have terminated. Raises Timeout."""
        remaining = _wait_for_all([task for task in tasks if task.stop(why)], _PATIENCE)
        self._warn(remaining, "was stopped")
        if remaining := _wait_for_all(remaining, _STOPS_WITHIN - _PATIENCE):
            self._remember_hung(remaining)
            raise Timeout(
                f"{_names(remaining)} did not end within {_STOPS_WITHIN:g} s of being stopped"
            )

    def stop_after(self, error: BaseException, tasks: Sequence[TaskHandle], why: str) -> None:
        """Stop tasks because of *error*, which the caller raises afterwards.

        After a Ctrl-C, another Ctrl-C ends the wait. A task that does not end is then only logged,
        because a Timeout would hide the KeyboardInterrupt.
        """
        if not isinstance(error, KeyboardInterrupt):
            self.stop(tasks, why)
            return
        try:
            self.stop(tasks, why)
        except KeyboardInterrupt:
            self._remember_hung(tasks)
            raise
        except Timeout as late:
            self._log.warning("%s", late)

    def stop_at_end(self, tasks: Sequence[TaskHandle], why: str) -> None:
        """Stop all running tasks at the end of the mission.

        If a task is known to hang, wait for no task: the wait would be in vain.
        """
        try:
            if self.hung:
                for task in tasks:
                    task.stop(why)
            else:
                self.stop(tasks, why)
        except KeyboardInterrupt:
            self._remember_hung(tasks)
            raise
        finally:
            if self.hung and (remaining := _not_ended(tasks)):
                self._log.warning(
                    "the mission ends without waiting any longer for %s: still running",
                    _names(remaining),
                )

    def warn_of_hung(self, tasks: Sequence[TaskHandle]) -> None:
        """Warn of each awaited task that was stopped or has failed, and does not end."""
        for task in tasks:
            if task.id in self._warned or task.is_known_over or (info := task.sent.info()) is None:
                continue
            if not (info.killed or info.failure):
                self._stopped_since.pop(task.id, None)
            elif (
                time.monotonic()
                >= self._stopped_since.setdefault(task.id, time.monotonic()) + _PATIENCE
            ):
                self._warn([task], "has failed" if info.failure else "was stopped")

    def forget(self, task: TaskHandle) -> None:
        """Remove the records of a task that has ended."""
        self.hung.pop(task.id, None)
        self._stopped_since.pop(task.id, None)
        self._warned.discard(task.id)

    def _warn(self, tasks: Sequence[TaskHandle], event: str) -> None:
        for task in tasks:
            self._warned.add(task.id)
            self._log.warning("waits for %s, which %s and does not return", task, event)

    def _remember_hung(self, tasks: Sequence[TaskHandle]) -> None:
        self.hung |= {task.id: task for task in _not_ended(tasks)}


def _wait_for_all(tasks: Sequence[TaskHandle], seconds: float) -> list[TaskHandle]:
    """Wait until all tasks have ended, at most *seconds*. Returns those that have not."""
    until = time.monotonic() + seconds
    while remaining := _not_ended(tasks):
        ended = wait_for_any([task.sent for task in remaining], max(0.0, until - time.monotonic()))
        if not ended:
            return remaining
        for task in remaining:
            if task.sent in ended:
                task.record_end()
    return []


def _not_ended(tasks: Sequence[TaskHandle]) -> list[TaskHandle]:
    return [task for task in tasks if not task.is_known_over]


def _names(tasks: Sequence[TaskHandle]) -> str:
    return ", ".join(map(str, tasks))
