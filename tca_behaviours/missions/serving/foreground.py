"""The foreground of a server: one task at a time. A newer task replaces the older one."""

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator

from tca_module import CentralLost, Refused, Task

_PATIENCE = 2.0  # seconds that a task waits for the task before until it warns
_WARNING_PERIOD = 5.0  # seconds between further warnings


class Foreground:
    """The task that has the foreground, and the newest task that wants it. Thread-safe."""

    def __init__(
        self, on_empty: Callable[[Task, BaseException | None], None], log: logging.Logger
    ) -> None:
        """*on_empty* is called, in any thread, when no task has or wants the foreground any more.

        Its arguments are the task that left last, and that task's error or None.
        """
        self._on_empty = on_empty
        self._log = log
        self._lock = threading.Lock()
        self._holder: Task | None = None  #: the task in the foreground, until it has terminated
        self._newest: Task | None = None  #: the newest task that wants the foreground
        #: For each older task whose thread has yet to arrive, by number: the name of a newer task.
        self._overtaken: dict[int, str] = {}

    @property
    def is_empty(self) -> bool:
        """Whether no task has the foreground or waits for it."""
        return self._newest is None and self._holder is None

    @contextlib.contextmanager
    def held_by(self, task: Task, publish_wait: Callable[[str], None]) -> Iterator[None]:
        """A block in which *task* has the foreground.

        The task before is killed first. *task* waits until the task before has terminated. If the
        wait is long, *publish_wait* is called with the name of the task before, and with "" after
        the wait. Raises TaskKilled if a newer task wants the foreground first.
        """
        before = self._become_newest(task)
        try:
            # If central has forgotten the task before, a kill is not necessary.
            with contextlib.suppress(CentralLost):
                if before is not None and (ref := task.task(before.id)) is not None:
                    ref.kill(f"{task} took its place")
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
        while True:
            self._log.warning("%s waits until %s has terminated", task, self._holder)
            if task.wait_until(lambda: self._acquire(task), _WARNING_PERIOD):
                break
        publish_wait("")

    def forget(self, task: Task) -> None:
        """Remove the record of a task whose run has ended."""
        with self._lock:
            self._overtaken.pop(task.id, None)

    def _become_newest(self, task: Task) -> Task | None:
        """Make *task* the newest. Returns the task before.

        Raises TaskKilled if the thread of a newer task came first. Two threads that start at once
        may arrive in any order.
        """
        handled = _handled_with(task)
        with self._lock:
            newer = self._overtaken.pop(task.id, "")
            if not newer:
                # Tasks that are not handled any more have ended and never arrive: forget them.
                awaited = {
                    number: by for number, by in self._overtaken.items() if number in handled
                }
                older = {number: str(task) for number in handled if number < task.id}
                self._overtaken = awaited | older
                before, self._newest = self._newest or self._holder, task
                return before
        task.kill(f"{newer} took its place")
        task.wait_until(lambda: False)  # raises TaskKilled
        raise AssertionError

    def _acquire(self, task: Task) -> bool:
        """Give *task* the foreground if it is free and no newer task wants it. Returns whether
        *task* has it.
        """
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
    """Return the numbers of the tasks that the resource of *task* handles now.

    The set is empty if permissions hide them.
    """
    with contextlib.suppress(Refused):
        resources = [resource for module in task.modules() for resource in module.resources]
        return next((set(each.handling) for each in resources if task.id in each.handling), set())
    return set()
