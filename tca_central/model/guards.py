"""Guards: the tasks with exception handlers, so that a failing task knows the nearest one above it without a search.

Theory of operation. Each task refers to a guard: the nearest task at or above it that has exception handlers, its own
or those of its message; the root always is one. A new task takes over its parent's guard, or becomes one itself. A task
that gets its first exception handler when others are under it already, or a message of which there are tasks, begins a
new *age*: a guard of an earlier age counts for nothing, and the first search that comes by one walks up from there, and
leaves the new guards at all tasks that it passes. So in one age each task is walked over once at most, however many
failures there are and however deep.

A guard that has lost its exception handlers stays one, so that it may get others without a new age, until a search
has passed over too many of these.
"""

from collections.abc import Iterator
from typing import Any, Protocol

from tca_central.model.stored import Stored

MOST_IDLE = 16
"""Guards without exception handlers that one search passes over."""


class Guarded(Protocol):
    """A task, as far as guards go."""

    parent: Any
    children: Any
    guard: "Guard | None"

    @property
    def has_exception_handlers(self) -> bool:
        """Whether any are attached to it or to its message."""


class Guard(Stored):
    """A task that has exception handlers, or had some."""

    __slots__ = ("above", "age", "task")

    def __init__(self, task: Guarded, above: "Guard | None", age: int) -> None:
        self.task, self.above, self.age = task, above, age


class Guards(Stored):
    """The guards of all tasks under a root."""

    def __init__(self, root: Guarded) -> None:
        self._root = root
        self.age = 0
        root.guard = Guard(root, None, self.age)

    def add(self, task: Guarded) -> None:
        """A new task hangs under its parent."""
        task.guard = task.parent.guard
        if task.has_exception_handlers:
            self._become_guard(task)

    def attached_to(self, task: Guarded) -> None:
        """An exception handler was attached to a task."""
        guard = task.guard
        if guard is not None and guard.task is task and guard.age == self.age:
            return
        if task.children:
            self.begin_age()
        else:
            self._become_guard(task)

    def begin_age(self) -> None:
        """Make all guards void."""
        self.age += 1
        self._root.guard = Guard(self._root, None, self.age)

    def above(self, task: Guarded) -> Iterator[Any]:
        """The tasks that have exception handlers, from *task* up, nearest first."""
        idle = 0
        guard: Guard | None = self._nearest(task)
        while guard is not None:
            if guard.task.has_exception_handlers:
                yield guard.task
            else:
                idle += 1
            if idle > MOST_IDLE:
                self.begin_age()
                idle = 0
            guard = self._next(guard)

    def _next(self, guard: Guard) -> Guard | None:
        if guard.task is self._root:
            return None
        if guard.above is None or guard.above.age != self.age:
            guard.above = self._nearest(guard.task.parent)
        return guard.above

    def _nearest(self, task: Guarded) -> Guard:
        """The guard of a task. Walks up to where it is known."""
        passed: list[Guarded] = []
        while (guard := task.guard) is None or guard.age != self.age:
            passed.append(task)
            task = task.parent
        for below in reversed(passed):
            below.guard = guard
            if below.has_exception_handlers:
                guard = self._become_guard(below)
        return guard

    def _become_guard(self, task: Guarded) -> Guard:
        task.guard = guard = Guard(task, task.parent.guard, self.age)
        return guard
