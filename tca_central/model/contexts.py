"""The reasons for messages that central makes, such as the failure for an exception handler."""

from enum import Enum
from typing import NamedTuple

from tca_central.model.deliveries import AttachedHandler, Delivery, Wiretap
from tca_central.model.stored import Stored
from tca_central.model.tasks import Recovery, Task, Watch, involved
from tca_wire.packets.parts import Tapped, Trouble


class RaisedFailure(NamedTuple):
    """A failure as it was raised on a task."""

    name: str
    text: str = ""
    body: bytes = b""
    kinds: tuple[str, ...] = ()  #: names of more general failures that include it


class Decision(Enum):
    """The decision of an exception handler so far."""

    NONE = "none"
    """When its task has ended, the search for a handler continues above it."""
    DEALT_WITH = "dealt with"
    """The handler resolves the failure or wants a retry. This takes effect when its task has ended.
    """
    VOID = "void"
    """It decides nothing any more: it reissued or was killed, or a retry has made the failure void.
    """


class FailureContext(Stored):
    """The failure for which an exception handler is called, and the handler's decision.

    The failure was raised on the task ``failing``. The handler was found ``at`` it or a task above.
    """

    __slots__ = ("at", "attached", "decision", "failing", "failure", "passed", "retried")

    def __init__(
        self,
        failing: Task,
        failure: RaisedFailure,
        at: Task,
        attached: AttachedHandler,
        passed: dict[tuple[int, str], None],
    ) -> None:
        self.failing, self.failure, self.at, self.attached = failing, failure, at, attached
        #: (attachment id, failure name) of handlers that have passed on this failure, or that of a
        #: task below. With the name "", the handler's own retry was refused.
        self.passed = passed
        self.decision = Decision.NONE
        self.retried: list[Task] = []  #: tasks that it wants retried

    @property
    def header(self) -> Trouble:
        """The context that the handler gets: the failure, and the tasks concerned."""
        attempts = Recovery.of(self.failing).attempts
        invocations = Recovery.of(self.at).invocations.get(self.attached.id, 0)
        name, text, *_ = self.failure
        return Trouble(name, text, involved(self.failing), involved(self.at), attempts, invocations)


class Listening(Stored):
    """The cause of a listener: the wiretap, and the message that it taps."""

    __slots__ = ("tap", "tapped")

    def __init__(self, tap: Wiretap, tapped: Delivery) -> None:
        self.tap, self.tapped = tap, involved(tapped)

    @property
    def header(self) -> Tapped:
        """The context that the listener's handler gets."""
        return Tapped(self.tap.condition, self.tapped)


def trouble_of(handler: Delivery) -> FailureContext:
    """Return the context of an exception handler."""
    assert isinstance(handler.context, FailureContext)
    return handler.context


def retried_by(task: Task) -> list[Task]:
    """Return the tasks that an exception handler wants retried; [] for other tasks."""
    return task.context.retried if isinstance(task.context, FailureContext) else []


def listener_cause(listener: Delivery) -> Listening:
    """Return the cause of a listener."""
    assert isinstance(listener.context, Listening)
    return listener.context


def monitor_of(delivery: Delivery) -> Watch:
    """Return the monitor that has sent a condition, action, set-up or cancel."""
    assert isinstance(delivery.context, Watch)
    return delivery.context
