"""The foreground of a server: one task at a time. A newer task takes the place of the older."""

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator

from tca_module import CentralLost, Refused, Task, TaskRef

_PATIENCE = 2.0  # seconds that a task waits for the one before until it warns
_WARNING_PERIOD = 5.0  # seconds between further warnings


class Foreground:
    """The task that has the foreground, and the newest task that wants it. Thread-safe."""

    def __init__(
        self, on_empty: Callable[[Task, BaseException | None], None], log: logging.Logger
    ) -> None:
        """*on_empty* is called, in any thread, when no task has or wants the foreground any more.

        It gets the last task that had it, and that task's error or None.
        """
        self._on_empty = on_empty
        self._log = log
        self._lock = threading.Lock()
        self._holder: Task | None = None  #: the task that has it, until it has terminated
        self._newest: Task | None = None  #: the newest task that wants the foreground
        #: The numbers of older tasks whose threads have yet to arrive, with the newer task's name.
        self._late: dict[int, str] = {}

    @property
    def is_empty(self) -> bool:
        """Whether no task has the foreground or waits for it."""
        return self._newest is None and self._holder is None

    @contextlib.contextmanager
    def held_by(self, task: Task, publish_wait: Callable[[str], None]) -> Iterator[None]:
        """A block in which *task* has the foreground.

        It kills the task before, and waits until that has terminated. If that takes long,
        *publish_wait* is called with the name of the task before, and with "" after the wait.
        Raises TaskKilled if a newer task takes the place first.
        """
        before = self._become_newest(task)
        try:
            if before is not None:
                _kill(before, task)
            self._wait(task, publish_wait)
            yield
        except BaseException as error:
            self._leave(task, error)
            raise
        self._leave(task, None)

    def _wait(self, task: Task, publish_wait: Callable[[str], None]) -> None:
        """Wait until *task* has the foreground."""
        if task.wait_until(lambda: self._acquire(task), _PATIENCE):
            return
        publish_wait(str(self._holder))
        self._log.warning("%s waits until %s has terminated", task, self._holder)
        while not task.wait_until(lambda: self._acquire(task), _WARNING_PERIOD):
            self._log.warning("%s waits until %s has terminated", task, self._holder)
        publish_wait("")

    def forget(self, task: Task) -> None:
        """Remove the record of a task whose run has ended."""
        with self._lock:
            self._late.pop(task.id, None)

    def _become_newest(self, task: Task) -> Task | None:
        """Make *task* the newest. Returns the task before.

        Raises TaskKilled if a newer task was here before it: two threads that start at once may
        arrive in any order.
        """
        handled = _handled_with(task)
        with self._lock:
            overtaken_by = self._late.pop(task.id, "")
            if not overtaken_by:
                known = {number: by for number, by in self._late.items() if number in handled}
                self._late = known | {number: str(task) for number in handled if number < task.id}
                before, self._newest = self._newest or self._holder, task
                return before
        task.kill(f"{overtaken_by} took its place")
        task.wait_until(lambda: False)
        raise AssertionError

    def _acquire(self, task: Task) -> bool:
        with self._lock:
            if self._holder is None and self._newest is task:
                self._holder = task
            return self._holder is task

    def _leave(self, task: Task, error: BaseException | None) -> None:
        with self._lock:
            if self._holder is task:
                self._holder = None
            if self._newest is task:
                self._newest = None
            newest, is_empty = self._newest, self.is_empty
        if newest is not None:
            newest.wake()
        elif is_empty:
            self._on_empty(task, error)


def _handled_with(task: Task) -> set[int]:
    """The numbers of the tasks that are handled at the same time; none if permissions hide them."""
    with contextlib.suppress(Refused):
        resources = [resource for module in task.modules() for resource in module.resources]
        return next((set(each.handling) for each in resources if task.id in each.handling), set())
    return set()


def _kill(before: Task, task: Task) -> None:
    """Kill the task before. If central has forgotten it, it ends without a kill."""
    with contextlib.suppress(CentralLost):
        other: TaskRef | None = task.task(before.id)
        if other is not None:
            other.kill(f"{task} took its place")
