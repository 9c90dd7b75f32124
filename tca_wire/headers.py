"""The headers that modules and central exchange, one type a message; the field order is the wire order.

A header travels with a body of opaque bytes (user data as MessagePack; central never looks inside). Types named in
the imperative are sent by a module, the others by central. ``number`` counts a connection's requests: the answer to
a request carries the same number, and 0 means that no answer is wanted. docs/protocol.md has the bytes.
"""

from enum import IntEnum, StrEnum
from typing import Literal

import msgspec

from tca_wire.constraints import Constraint, Flags
from tca_wire.points import Point, TaskId

PROTOCOL_VERSION = 1


class MessageClass(StrEnum):
    """How a message is routed and whether it becomes a task (semantics: TCA 8.5, message classes)."""

    INFORM = "inform"
    QUERY = "query"
    BROADCAST = "broadcast"
    MULTI_QUERY = "multi-query"
    GOAL = "goal"
    COMMAND = "command"
    VARIABLE = "variable"

    @property
    def is_task(self) -> bool:
        """Whether such a message becomes a node of the task tree."""
        return self in (MessageClass.GOAL, MessageClass.COMMAND)

    @property
    def has_reply(self) -> bool:
        """Whether the sender of such a message is answered by its handlers."""
        return self in (MessageClass.QUERY, MessageClass.MULTI_QUERY)


class Outcome(StrEnum):
    """How a message or task ended."""

    DONE = "done"
    FAILED = "failed"
    KILLED = "killed"


class Refusal(StrEnum):
    """Why central refused a request."""

    PROTOCOL = "protocol"  # illegal here: unknown version, not said hello, no such moment, ...
    FORMAT = "format"  # the format or class of a message is not the one that others use
    UNKNOWN = "unknown"  # no such message, task or resource
    CYCLE = "cycle"  # the constraints could never be met
    TOO_LATE = "too late"  # the point has been reached already
    OVERLOAD = "overload"  # a bounded queue is full


class _Header(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What all headers share: an array on the wire, whose first element is the kind."""


class MessageFormat(_Header, frozen=True):
    """A message's name, class and formats (JSON Schema as text; "" where the class has no reply)."""

    name: str
    message_class: MessageClass
    data: str
    reply: str = ""


class HandlerFormat(_Header, frozen=True):
    """A message that a module handles, in which resource; handlers of one *pool* share the messages."""

    message: str
    resource: str
    pool: str = ""
    pending: int = 0
    """At most so many of them wait for this handler, the newest ones (0: no such limit)."""


# --- from a module to central -------------------------------------------------------------------------------------


class Hello(_Header, frozen=True, tag=1):
    """First message of a connection, and again after a reconnect. Answered by Welcome or Refused."""

    number: int
    version: int
    module: str
    incarnation: str
    """The same for all connections of one run of a module, and no other."""
    connection: int = 0
    """Which of that module's connections this is: 0 is its own, the others handle messages."""
    resource: str = ""
    """The resource whose messages this connection handles, if any: one at a time."""
    process: str = ""
    """Where the module runs, for people: "host:pid"."""


class Register(_Header, frozen=True, tag=2):
    """Declare messages, and say which of them this module handles."""

    number: int
    messages: list[MessageFormat]
    handlers: list[HandlerFormat] = []


class Unregister(_Header, frozen=True, tag=3):
    """This module handles these messages no longer (all of its handlers when the list is empty)."""

    number: int
    messages: list[str]


class Send(_Header, frozen=True, tag=4):
    """Send a message of any class; the body is its data. Answered by Accepted or Refused, then by Answer where due."""

    number: int
    message: str
    parent: TaskId = TaskId(0)
    """The task that a goal or command becomes a child of (0: the root)."""
    origin: int = 0
    """The delivery that the sender is handling (0: none)."""
    flags: Flags = Flags.SEQ_ACH
    constraints: list[Constraint] = []
    priority: int = 0
    blocking: bool = False
    """The sender's connection does nothing else until the answer is there."""
    maximum: int = 0
    """Of a multi-query: how many replies are wanted (0: from every handler)."""
    if_handled: bool = False
    """Only if somebody handles the message now; else the answer is Accepted with id 0 (TCA 8.5: MaybeExecute)."""


class Reply(_Header, frozen=True, tag=5):
    """The handler of a delivery returned; the body is its reply or result."""

    delivery: int


class Fail(_Header, frozen=True, tag=6):
    """The handler of a delivery failed; the body is the failure's data."""

    delivery: int
    failure: str
    text: str = ""


class Constrain(_Header, frozen=True, tag=7):
    """Add constraints between points of existing tasks."""

    number: int
    constraints: list[Constraint]


class WaitFor(_Header, frozen=True, tag=8):
    """Answer when this point has been reached."""

    number: int
    point: Point
    origin: int = 0


class GiveUp(_Header, frozen=True, tag=9):
    """The sender no longer waits for the answer to request *request*."""

    request: int


class Kill(_Header, frozen=True, tag=10):
    """End a task and everything under it."""

    number: int
    task: TaskId
    why: str = ""


class Ask(_Header, frozen=True, tag=11):
    """What central knows of a topic; answered with a MessagePack map as body."""

    number: int
    topic: Literal["status", "modules", "messages", "tree", "variables"]


class Bye(_Header, frozen=True, tag=12):
    """This connection closes: of its own will, nothing failed."""


class GetVariable(_Header, frozen=True, tag=20):
    """What is the value of a variable? The body of the Answer is; it is empty if the variable was never set."""

    number: int
    variable: str


class SetVariable(_Header, frozen=True, tag=21):
    """Set a variable to the value in the body. Answered by Accepted or, with *swap*, as GetVariable was just before."""

    number: int
    variable: str
    origin: int = 0
    swap: bool = False


class WaitUntilHandled(_Header, frozen=True, tag=22):
    """Answer when each of these messages is handled by somebody, all at the same time."""

    number: int
    messages: list[str]


# --- from central to a module -------------------------------------------------------------------------------------


class Welcome(_Header, frozen=True, tag=33):
    """Answers Hello. *module* is the name by which the journal knows the module; *epoch* names this run of central."""

    number: int
    version: int
    module: str
    epoch: str


class Accepted(_Header, frozen=True, tag=34):
    """The request was taken; *id* is the task or message it became (0: neither)."""

    number: int
    id: int = 0


class Refused(_Header, frozen=True, tag=35):
    """The request was not taken, and nothing of it remains."""

    number: int
    refusal: Refusal
    text: str


class Answer(_Header, frozen=True, tag=36):
    """The answer to a query, a wait or a question; the body is the reply, result or failure data."""

    number: int
    outcome: Outcome = Outcome.DONE
    failure: str = ""
    text: str = ""
    more: bool = False
    """Of a multi-query: further answers follow; the one without *more* is the end and has no body."""


class Deliver(_Header, frozen=True, tag=37):
    """Handle this message and answer with Reply or Fail; the body is its data."""

    delivery: int
    message: str
    task: TaskId = TaskId(0)
    """The task that it is (0: it belongs to no tree)."""


class Cancelled(_Header, frozen=True, tag=38):
    """The task of this delivery has been killed: its handler should end soon."""

    delivery: int


class Beat(_Header, frozen=True, tag=39):
    """Central is alive."""


class Unknown(_Header, frozen=True, tag=40):
    """Central does not know this connection: say Hello again, then repeat what is not acknowledged."""


class Closing(_Header, frozen=True, tag=41):
    """Central ends."""

    text: str = ""


ToCentral = (
    Hello | Register | Unregister | Send | Reply | Fail | Constrain | WaitFor | GiveUp | Kill | Ask | Bye
    | GetVariable | SetVariable | WaitUntilHandled
)  # fmt: skip
ToModule = Welcome | Accepted | Refused | Answer | Deliver | Cancelled | Beat | Unknown | Closing


class Limit(IntEnum):
    """Bounds of the protocol, in bytes or items."""

    PACKET = 16 << 20
    BODY = 8 << 20
    NAME = 128
