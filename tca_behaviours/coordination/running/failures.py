"""Failures of the tasks that a coordinator has sent: they are noted, and the machine decides what
comes of them.

The exception handler is attached to the coordinator's message, before anybody else's: it is asked
after those of the failing task, of its message and of the coordinator's task, and before those of
the root.
"""

from itertools import takewhile
from typing import Any, NamedTuple

import msgspec

from tca_module import ExceptionHandler, Module, SentTask, Task, TaskFailed
from tca_wire.points import TaskId


class NotedFailure(NamedTuple):
    """A failure that nobody below the coordinator has dealt with."""

    name: str
    text: str
    data: Any
    """As plain values."""

    def error_of(self, sent: SentTask[Any]) -> TaskFailed:
        """The error with which the coordinator fails if it has no arrow for this."""
        body = b"" if self.data is None else msgspec.msgpack.encode(self.data)
        return TaskFailed(repr(sent), self.name, self.text, body)


class FailureNotes:
    """The failures of a coordinator's tasks, by task."""

    def __init__(self, coordinator: str) -> None:
        self.handler = ExceptionHandler(f"failure in {coordinator}", Any)
        self._noted: dict[TaskId, NotedFailure] = {}

    def handle_in(self, module: Module, coordinator: Any, resource: str) -> None:
        """Have the failures noted by a module that handles the message *coordinator*."""
        module.at_start(lambda module: module.on_failure(None, self.handler, of=coordinator))
        module.handles(self.handler, resource=resource)(self._note)

    def take(self, task: TaskId) -> NotedFailure | None:
        """The failure of a task that has ended."""
        return self._noted.pop(task, None)

    def _note(self, handling: Task, data: Any) -> None:
        trouble, failing, attached = (
            handling.trouble,
            handling.trouble.failing,
            handling.trouble.attached,
        )
        if attached is None or failing.id == attached.id:
            raise trouble.reissue()  # the coordinator's own
        above = [failing, *takewhile(lambda task: task.id != attached.id, failing.ancestors())][-1]
        self._noted[above.id] = NotedFailure(trouble.failure, trouble.text, data)
        if above is failing:
            trouble.resolved()  # the machine decides what comes of it
        else:
            above.kill(f"{failing} failed: {trouble.failure}: {trouble.text.partition(chr(10))[0]}")
