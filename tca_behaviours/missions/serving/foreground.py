"""The foreground of a server: one task at a time, and the newest takes the place of the one
before.
"""

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator

from tca_module import CentralLost, Refused, Task, TaskRef

_PATIENCE = 2.0  # seconds that a task waits for the one before without a word
_SAID_EVERY = 5.0  # seconds, then


class Foreground:
    """Who has the foreground, and who wants it. Threads of different tasks use it."""

    def __init__(
        self, on_empty: Callable[[Task, BaseException | None], None], log: logging.Logger
    ) -> None:
        """*on_empty* is called, in any thread, when nobody wants it any more: with the last and the
        error it had.
        """
        self._on_empty = on_empty
        self._log = log
        self._lock = threading.Lock()
        self._holder: Task | None = None  #: the task that has it, until it has terminated
        self._newest: Task | None = None  #: the last that came
        self._late: dict[
            int, str
        ] = {}  #: tasks that were overtaken before their threads came here -> by whom

    @property
    def is_empty(self) -> bool:
        """Whether nobody has it or waits for it."""
        return self._newest is None and self._holder is None

    @contextlib.contextmanager
    def taken(self, task: Task, tell_wait: Callable[[str], None]) -> Iterator[None]:
        """A block in which *task* has the foreground. It ends the task before, and waits until that
        has terminated. *tell_wait* is called with its name if that takes long, and with ""
        afterwards. Raises TaskKilled if a newer one comes first.
        """
        before = self._enter(task)
        try:
            if before is not None:
                _end(before, task)
            self._wait(task, tell_wait)
            yield
        except BaseException as error:
            self._leave(task, error)
            raise
        self._leave(task, None)

    def _wait(self, task: Task, tell_wait: Callable[[str], None]) -> None:
        """Wait until *task* has the foreground."""
        if task.wait_until(lambda: self._take(task), _PATIENCE):
            return
        tell_wait(str(self._holder))
        self._log.warning("%s waits until %s has terminated", task, self._holder)
        while not task.wait_until(lambda: self._take(task), _SAID_EVERY):
            self._log.warning("%s waits until %s has terminated", task, self._holder)
        tell_wait("")

    def forget(self, task: Task) -> None:
        """The run of a task has ended, in the foreground or not."""
        with self._lock:
            self._late.pop(task.id, None)

    def _enter(self, task: Task) -> Task | None:
        """Let *task* be the newest; the task before. Raises TaskKilled if it was overtaken: two
        threads that begin at once may come here in any order.
        """
        handled = _handled_with(task)
        with self._lock:
            overtaken_by = self._late.pop(task.id, "")
            if not overtaken_by:
                known = {one: by for one, by in self._late.items() if one in handled}
                self._late = known | {one: str(task) for one in handled if one < task.id}
                before, self._newest = self._newest or self._holder, task
                return before
        task.kill(f"{overtaken_by} took its place")
        task.wait_until(lambda: False)
        raise AssertionError

    def _take(self, task: Task) -> bool:
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
    """The tasks that are handled beside this one; none if the permissions keep that secret."""
    with contextlib.suppress(Refused):
        resources = [one for module in task.modules() for one in module.resources]
        return next((set(one.handling) for one in resources if task.id in one.handling), set())
    return set()


def _end(before: Task, task: Task) -> None:
    """Kill the task before. One that central has forgotten ends by itself."""
    with contextlib.suppress(CentralLost):
        other: TaskRef | None = task.task(before.id)
        if other is not None:
            other.kill(f"{task} took its place")
