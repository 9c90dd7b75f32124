"""The reasons for messages that central makes: the trouble of an exception handler, what a listener
listens to.
"""

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
    kinds: tuple[str, ...] = ()  #: more general failures that it is a kind of


class Decision(Enum):
    """What an exception handler has decided so far."""

    NONE = "none"
    """When its task has ended, the search goes on above it."""
    DEALT_WITH = "dealt with"
    """When its task has ended, its failure has been dealt with: it has said so, or wants a
    retry.
    """
    VOID = "void"
    """It decides nothing any more: it has reissued, or was killed, or the failure is forgotten."""


class FailureContext(Stored):
    """The trouble an exception handler's task deals with: a task's failure, caught there or above;
    and its decision.
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
        #: Attachments, by id, that could not decide about failures of these names; of this failure
        #: and all below it.
        self.passed = passed
        self.decision = Decision.NONE
        self.retried: list[Task] = []  #: the tasks that it wants retried

    @property
    def header(self) -> Trouble:
        """The handler's context: the failure, and the tasks that it is about."""
        attempts = Recovery.of(self.failing).attempts
        invocations = Recovery.of(self.at).invocations.get(self.attached.id, 0)
        name, text, *_ = self.failure
        return Trouble(name, text, involved(self.failing), involved(self.at), attempts, invocations)


class Listening(Stored):
    """The tap and message that a listener was sent for."""

    __slots__ = ("tap", "tapped")

    def __init__(self, tap: Wiretap, tapped: Delivery) -> None:
        self.tap, self.tapped = tap, involved(tapped)

    @property
    def header(self) -> Tapped:
        """The message to the listener's handler."""
        return Tapped(self.tap.condition, self.tapped)


def trouble_of(handler: Delivery) -> FailureContext:
    """What an exception handler is for."""
    assert isinstance(handler.context, FailureContext)
    return handler.context


def retried_by(task: Task) -> list[Task]:
    """The tasks that a task wants retried, if it is an exception handler."""
    return task.context.retried if isinstance(task.context, FailureContext) else []


def heard_by(listener: Delivery) -> Listening:
    """What a listener was sent for."""
    assert isinstance(listener.context, Listening)
    return listener.context


def monitor_of(delivery: Delivery) -> Watch:
    """The monitor that a condition, action, set-up or cancel was sent by."""
    assert isinstance(delivery.context, Watch)
    return delivery.context
