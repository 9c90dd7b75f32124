"""The parts of headers: formats, options, and the contexts of deliveries."""

from typing import Annotated

import msgspec

from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import Busy, Condition, Limit, MessageClass, Outcome, Party

MANY = msgspec.Meta(max_length=int(Limit.LIST))
"""Of a list in a header: so many entries, and no more."""


class WireArray(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """The base of all headers and their parts: an array on the wire. The first element of a header
    is its kind.
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


class MessageFormat(WireArray, frozen=True):
    """A message's name, class and formats (JSON Schema as text; "" where the class has no
    reply).
    """

    name: str
    message_class: MessageClass
    data: str
    reply: str = ""
    parts: Annotated[list[str], MANY] = []
    """The messages that a monitor sends: condition and action, or set-up, action and cancel ("" for
    none).
    """
    progress: str = ""
    """The format of a task's intermediate results ("": it has none)."""
    life_cycle: str = ""
    """The table of a task's life cycle ("": the general one)."""


class HandlerFormat(WireArray, frozen=True):
    """A message that a module handles, in which resource; handlers of one *pool* share the
    messages.
    """

    message: str
    resource: str
    pool: str = ""
    pending: int = 0
    """At most so many of them wait for this handler, the newest ones (0: no such limit)."""
    direct: bool = False
    """They come from their senders directly, if nothing speaks against it."""
    accepts: bool = False
    """The handler itself says when it accepts a task; else it has when it gets it."""
    takes: Annotated[list[str], MANY] = []
    """The transitions of clients that the handler is told of, and decides about."""
    refuses: Annotated[list[str], MANY] = []
    """Those that are refused in its name. Of the others an update restarts the task, a cancel kills
    it.
    """
    busy: Busy = Busy.QUEUE
    """What becomes of a task that has to wait for this handler."""


class EndedRun(WireArray, frozen=True, gc=False):
    """A run of a handler that has ended: how long ago, and how long it *took*, in seconds."""

    delivery: int
    ago: float
    took: float
    size: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Of what it returned, in bytes (0: nothing)."""


class Attachment(WireArray, frozen=True):
    """The attachment of an exception handler for a failure, at most *maximum* times (0: any number
    of times).
    """

    failure: str
    handler: str
    maximum: int = 0


class WatchOptions(WireArray, frozen=True):
    """The options of a monitor (TCA 8.5: CreateMonitorOptions). Times in seconds."""

    period: float = 0
    """The time between a polling monitor's tests of its condition."""
    maximum: int = 0
    """The number of actions that end it (0: any number)."""
    fire_every: int = 1
    """Every how many times that the condition holds, or that it is fired, an action is sent."""
    initial_wait: bool = False
    """Whether a polling monitor tests first after one period, not at once."""
    duration: float = 0
    """After how long it ends (0: not because of time)."""
    until: Point | None = None
    """The point at which it ends."""
    waited_for: bool = False
    """Its parent waits for its end: it does not end at the latest when all else under its parent
    has.
    """


class StateChange(WireArray, frozen=True):
    """A change of a task's state, or how the task stands."""

    task: TaskId
    message: str
    serial: int
    """The number of changes of this task so far."""
    state: str
    transition: str
    by: Party
    module: str = ""
    """Of the client or server."""
    text: str = ""
    """The reason, for people."""
    goal: bytes = b""
    """The task's data."""
    data: bytes = b""
    """The goal that is asked for, an intermediate result (the newest, where the task is told of as
    it stands), or the result.
    """
    is_late: bool = False
    """It was so before the observer came."""
    is_over: bool = False
    outcome: Outcome | None = None
    """How it ended, if it *is over*."""


class Involved(WireArray, frozen=True):
    """A task that another one is about."""

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
    """The number of calls of this exception handler for the task that it is attached to, this one
    included.
    """


class Tapped(WireArray, frozen=True, tag="tapped"):
    """The context of a listener."""

    condition: Condition
    tapped: Involved
    """The tapped task (task 0: the tapped message is none)."""


class Watching(WireArray, frozen=True, tag="watching"):
    """The monitor that sent its set-up, condition, action or cancel message."""

    monitor: Involved
    action: str = ""
    """The message that a demon monitor is fired with; "" if it sends none, or tests a condition."""
