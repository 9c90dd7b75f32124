"""What a handler is told beyond its data, where central sent the message itself."""

from typing import Any, Generic

from tca_module.connection import Connection
from tca_module.failing import Reissued
from tca_module.task_handle import TaskHandle
from tca_wire import parts
from tca_wire.declarations import D, Message
from tca_wire.headers import Deliver, EndMonitor, Fire
from tca_wire.vocabulary import Condition


class Trouble:
    """The failure that an exception handler is called for."""

    def __init__(
        self, failure: str, text: str, failing: TaskHandle, attached: TaskHandle | None, attempts: int, calls: int
    ) -> None:
        self.failure = failure  #: its name
        self.text = text
        self.failing = failing  #: the task on which it was raised
        self.attached = attached  #: the task that the exception handler is attached to; None: the root
        self.attempts = attempts  #: how often the failing task has been handled
        self.invocations = calls  #: how often this exception handler was called for the task it is attached to

    def __repr__(self) -> str:
        return f"failure '{self.failure}' of {self.failing}"

    def reissue(self) -> Exception:
        """What to raise if the failure can't be dealt with here: ``raise task.trouble.reissue()``. The search for an
        exception handler goes on above this one (TCA: ByPassException).
        """
        return Reissued(f"{self} is reissued")


class Heard:
    """What a listener was sent for."""

    def __init__(self, condition: Condition, message: str, tapped: TaskHandle | None) -> None:
        self.condition = condition
        self.message = message  #: the name of the tapped message
        self.tapped = tapped  #: the tapped task; None if the message is none


class MonitorHandle(TaskHandle, Generic[D]):
    """A monitor."""

    def fire(self, action: Message[Any, Any], data: Any = None) -> None:
        """What a demon monitor watches for has happened: its *action* is sent, with these data."""
        self._call(Fire(0, self.id, action.name), f"firing {self}", action.encode_data(data))

    def end(self) -> None:
        """Watch no longer; what the monitor has sent comes to its own end."""
        self._call(EndMonitor(0, self.id), f"ending {self}")


def context_of(connection: Connection, delivery: Deliver) -> "Trouble | Heard | MonitorHandle[Any] | None":
    """What a delivery is about."""

    def handle(involved: parts.Involved) -> TaskHandle | None:
        if not involved.task:
            return None
        return TaskHandle(connection, involved.message, involved.task, delivery.delivery)

    context = delivery.context
    if isinstance(context, parts.Trouble):
        failing = handle(context.failing)
        assert failing is not None
        attached = handle(context.attached)
        return Trouble(context.failure, context.text, failing, attached, context.attempts, context.invocations)
    if isinstance(context, parts.Tapped):
        return Heard(context.condition, context.tapped.message, handle(context.tapped))
    if isinstance(context, parts.Watching):
        return MonitorHandle(connection, context.monitor.message, context.monitor.task, delivery.delivery)
    return None
