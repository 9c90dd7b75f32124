"""The foreground of a server: one task at a time, and the newest takes the place of the one before."""

import contextlib
import threading
from collections.abc import Callable, Iterator

from tca_module import CentralLost, Task, TaskRef


class Foreground:
    """Who has the foreground, and who wants it. Threads of different tasks use it."""

    def __init__(self, on_empty: Callable[[Task, BaseException | None], None]) -> None:
        """*on_empty* is called, in any thread, when nobody wants it any more: with the last and the error it had."""
        self._on_empty = on_empty
        self._lock = threading.Lock()
        self._holder: Task | None = None  #: the task that has it, until it has terminated
        self._newest: Task | None = None  #: the last that came

    @property
    def is_empty(self) -> bool:
        """Whether nobody has it or waits for it."""
        return self._newest is None

    @contextlib.contextmanager
    def taken(self, task: Task) -> Iterator[None]:
        """A block in which *task* has the foreground. It ends the task before, and waits until that has terminated.
        Raises TaskKilled if a newer one comes first.
        """
        with self._lock:
            before, self._newest = self._newest, task
        try:
            if before is not None:
                _end(before, task)
            task.wait_until(lambda: self._take(task))
            yield
        except BaseException as error:
            self._leave(task, error)
            raise
        self._leave(task, None)

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
            newest = self._newest
        if newest is not None:
            newest.wake()
        else:
            self._on_empty(task, error)


def _end(before: Task, task: Task) -> None:
    """Kill the task before. One that central has forgotten ends by itself."""
    with contextlib.suppress(CentralLost):
        other: TaskRef | None = task.task(before.id)
        if other is not None:
            other.kill(f"{task} took its place")
