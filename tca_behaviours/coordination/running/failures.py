"""Failures of the tasks that a coordinator has sent: they are recorded, and the machine reacts.

The exception handler is attached to the coordinator's message. Central asks this handler after
those attached to the failing task, its message and the coordinator's task. It asks the root's
handlers later.
"""

from itertools import takewhile
from typing import Any, NamedTuple

import msgspec

from tca_module import ExceptionHandler, Module, SentTask, Task, TaskFailed
from tca_wire.points import TaskId


class RecordedFailure(NamedTuple):
    """A failure that no handler below the coordinator has resolved."""

    name: str
    text: str
    data: Any
    """Plain values."""

    def error_of(self, sent: SentTask[Any]) -> TaskFailed:
        """Return the error with which the coordinator fails if the machine has no arrow for the
        failure.
        """
        body = b"" if self.data is None else msgspec.msgpack.encode(self.data)
        return TaskFailed(repr(sent), self.name, self.text, body)


class RecordedFailures:
    """The failures of a coordinator's tasks, by task."""

    def __init__(self, coordinator: str) -> None:
        self.handler = ExceptionHandler(f"failure in {coordinator}", Any)
        self._failures: dict[TaskId, RecordedFailure] = {}

    def handle_in(self, module: Module, coordinator: Any, resource: str) -> None:
        """Let a module that handles the message *coordinator* record the failures."""
        module.at_start(lambda module: module.on_failure(None, self.handler, of=coordinator))
        module.handles(self.handler, resource=resource)(self._record)

    def pop(self, task: TaskId) -> RecordedFailure | None:
        """Remove and return the failure of a task that has ended, if any."""
        return self._failures.pop(task, None)

    def _record(self, handling: Task, data: Any) -> None:
        trouble = handling.trouble
        failing, coordinator = trouble.failing, trouble.attached
        if coordinator is None or failing.id == coordinator.id:
            raise trouble.reissue()  # the failure of the coordinator's own task
        below_coordinator = takewhile(lambda task: task.id != coordinator.id, failing.ancestors())
        sent = [failing, *below_coordinator][-1]  # the task that the coordinator has sent
        self._failures[sent.id] = RecordedFailure(trouble.failure, trouble.text, data)
        if sent is failing:
            trouble.resolved()  # the machine decides how to react
        else:
            sent.kill(f"{failing} failed: {trouble.failure}: {trouble.text.partition(chr(10))[0]}")
