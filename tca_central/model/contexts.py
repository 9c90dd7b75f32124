"""The reasons for messages that central makes.

For an exception handler, for example, the reason is a failure. Handlers get the reason as the
*context* of the message.
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
    kinds: tuple[str, ...] = ()  #: names of more general failures that include this one


BY_POLICY = 0
"""The number that stands for a retry policy where attachments have theirs."""


class Decision(Enum):
    """The decision of an exception handler so far."""

    NONE = "none"
    """No decision. If the handler's task ends without one, the search continues above it."""
    DEALT_WITH = "dealt with"
    """The handler has resolved the failure or asked for a retry.

    The decision takes effect when the handler's task has ended.
    """
    VOID = "void"
    """The handler decides nothing any more.

    It has reissued the failure, it could not decide, it was killed, or the failing task is retried.
    """


class FailureContext(Stored):
    """The failure for which an exception handler is called, and the handler's decision.

    The failure was raised on the task ``failing``. The handler was found on the task ``at``, which
    is ``failing`` or an ancestor of ``failing``.
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
        #: Handlers that could not decide about a failure: (attachment id, failure name). They are
        #: not called for that failure again. Failures inside this handler share the dictionary.
        #: The name is "" if the handler's own retry was refused.
        self.passed = passed
        self.decision = self.initial_decision
        self.retried: list[Task] = []  #: tasks that the handler wants retried

    @property
    def is_fallback(self) -> bool:
        """Whether the handler is the fallback of a retry policy."""
        return self.attached.id == BY_POLICY

    @property
    def initial_decision(self) -> Decision:
        """The decision at the start of each handling: a fallback deals with the failure."""
        return Decision.DEALT_WITH if self.is_fallback else Decision.NONE

    @property
    def header(self) -> Trouble:
        """The context that the handler gets: the failure, ``failing``, ``at`` and two counts."""
        attempts = Recovery.of(self.failing).attempts
        invocations = Recovery.of(self.at).invocations.get(self.attached.id, 0)
        name, text, *_ = self.failure
        return Trouble(name, text, involved(self.failing), involved(self.at), attempts, invocations)


class Listening(Stored):
    """The cause of a listener: the wiretap, and the message that was tapped."""

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
