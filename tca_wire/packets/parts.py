"""The parts of headers: formats, options, and the contexts of deliveries."""

from typing import Annotated

import msgspec

from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import Busy, Condition, Limit, MessageClass, Outcome, Party

MANY = msgspec.Meta(max_length=int(Limit.LIST))
"""The limit for a list in a header."""


class WireArray(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """The base of all headers and their parts: an array on the wire.

    The first element of a header is its kind.
    """


class Numbered(WireArray, frozen=True):
    """A request, or the answer to one."""

    number: int


class OfTask(Numbered, frozen=True):
    """A request about a task."""

    task: TaskId


class OfDelivery(WireArray, frozen=True):
    """A header about a delivery."""

    delivery: int


class RetryPolicy(WireArray, frozen=True):
    """The retries of a task that central makes by itself, and its *fallback*. Times in seconds."""

    attempts: int
    """The greatest number of handlings of the task, with the first one."""
    pause: float = 0
    """The pause before the first retry."""
    backoff: float = 1
    """The factor of each further pause."""
    longest_pause: float = 0
    """The bound of all pauses."""
    attempt_timeout: float = 0
    """The time after which a running attempt fails with "timeout" (0: no limit)."""
    failures: Annotated[list[str], MANY] = []
    """The failures that the policy is for; without any, all but "uncertain"."""
    fallback: str = ""
    """The goal or command that replaces the task after its last attempt ("": none)."""
    data: bytes = b""
    """The data of the fallback (empty: the task's own data)."""


class MessageFormat(WireArray, frozen=True):
    """A message's name, class and formats (JSON Schema as text; "" for no reply)."""

    name: str
    message_class: MessageClass
    data: str
    reply: str = ""
    parts: Annotated[list[str], MANY] = []
    """The messages that a monitor sends: condition and action, or set-up, action and cancel.

    "" stands for a missing one.
    """
    progress: str = ""
    """The format of a task's intermediate results ("": it has none)."""
    life_cycle: str = ""
    """The table of a task's life cycle ("": the general one)."""
    retry: RetryPolicy | None = None
    """The retry policy of its tasks, unless their sender gives another one."""

    @property
    def needs(self) -> list[str]:
        """The messages that must be declared before this one: its parts and its fallback."""
        fallback = [self.retry.fallback] if self.retry is not None and self.retry.fallback else []
        return [part for part in self.parts if part] + fallback


class HandlerFormat(WireArray, frozen=True):
    """A message that a module handles, and its resource; handlers of one *pool* share messages."""

    message: str
    resource: str
    pool: str = ""
    pending: int = 0
    """The limit for messages that wait for this handler; the newest are kept (0: no limit)."""
    accepts: bool = False
    """The handler itself accepts a task; else a task is accepted when the handler gets it."""
    takes: Annotated[list[str], MANY] = []
    """The transitions of clients that the handler decides about."""
    refuses: Annotated[list[str], MANY] = []
    """The transitions of clients that central refuses for the handler.

    An update that is in neither *takes* nor *refuses* restarts the task. Such a cancel kills the
    task.
    """
    busy: Busy = Busy.QUEUE
    """The fate of a task that would have to wait for this handler."""


class EndedRun(WireArray, frozen=True, gc=False):
    """A run of a handler that ended *ago* seconds ago, after *took* seconds."""

    delivery: int
    ago: float
    took: float
    size: Annotated[int, msgspec.Meta(ge=0)] = 0
    """The bytes of its reply (0: none)."""


class Attachment(WireArray, frozen=True):
    """The attachment of an exception handler to a failure, for *maximum* calls (0: no limit)."""

    failure: str
    handler: str
    maximum: int = 0


class WatchOptions(WireArray, frozen=True):
    """The options of a monitor (TCA 8.5: CreateMonitorOptions). Times in seconds."""

    period: float = 0
    """The time between a polling monitor's tests of its condition."""
    maximum: int = 0
    """The number of actions that end it (0: no limit)."""
    fire_every: int = 1
    """Send an action only every n-th time that the condition holds, or that it is fired."""
    initial_wait: bool = False
    """Whether a polling monitor tests first after one period, not at once."""
    duration: float = 0
    """The time after which it ends (0: no limit)."""
    until: Point | None = None
    """The point at which it ends."""
    waited_for: bool = False
    """The parent waits for its end. Otherwise it ends when all else under the parent has ended."""


class StateChange(WireArray, frozen=True):
    """A change of a task's state, or its present state."""

    task: TaskId
    message: str
    serial: int
    """The number of changes of this task so far."""
    state: str
    transition: str
    by: Party
    module: str = ""
    """The module of the client or server."""
    text: str = ""
    """The reason, for display."""
    goal: bytes = b""
    """The task's data."""
    data: bytes = b""
    """The requested goal, an intermediate result, or the result.

    A report of the present state has the newest intermediate result.
    """
    is_late: bool = False
    """The task was in this state before the observation began."""
    is_over: bool = False
    outcome: Outcome | None = None
    """The outcome, if *is_over*."""
    request: int = 0
    """The number of the client's request that made this change, or that this change answers.

    It is the number in central's Accepted (0: no such request).
    """


class Involved(WireArray, frozen=True):
    """A task to which the context of a delivery refers."""

    task: TaskId
    message: str


class Trouble(WireArray, frozen=True, tag="trouble"):
    """The context of an exception handler; the body of the delivery is the failure's data."""

    failure: str
    text: str
    failing: Involved
    attached: Involved
    """The task that the exception handler is attached to (task 0: the root)."""
    attempts: int
    """The number of times that the failing task has been handled."""
    invocations: int
    """The number of this exception handler's calls for its attached task, including this one."""


class Tapped(WireArray, frozen=True, tag="tapped"):
    """The context of a listener."""

    condition: Condition
    tapped: Involved
    """The tapped task (task 0: the tapped message is not a task)."""


class Watching(WireArray, frozen=True, tag="watching"):
    """The context of a monitor's set-up, condition, action or cancel message."""

    monitor: Involved
    action: str = ""
    """The action of a demon monitor; "" if it has none, or tests a condition."""
