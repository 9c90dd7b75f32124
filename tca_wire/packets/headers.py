"""The headers that modules and central exchange, one class for each kind.

The field order is the wire order. A header travels with a body of opaque bytes: user data as
MessagePack, which central never decodes. First come the headers that modules send, then those of
central. changes.py has the headers about states of tasks, and resources.py those about locks and
variables. docs/reference/protocol.md has the bytes.

``number`` counts a connection's requests. The answer to a request has the number of the request. A
request with number 0 wants no answer. ``origin`` is the delivery whose handler sends the request
(0: code outside of handlers). A task id below -1 names a task that this connection has sent: -7 is
the task of request 7.
"""

from typing import Annotated, Literal

from tca_wire.constraints import Constraint, Flags
from tca_wire.packets.changes import ChangeState, Observe, Requested
from tca_wire.packets.parts import (
    MANY,
    Attachment,
    EndedRun,
    HandlerFormat,
    MessageFormat,
    Numbered,
    OfDelivery,
    OfTask,
    RetryPolicy,
    Tapped,
    Trouble,
    Watching,
    WatchOptions,
    WireArray,
)
from tca_wire.packets.resources import GetVariable as GetVariable
from tca_wire.packets.resources import Lock as Lock
from tca_wire.packets.resources import Release as Release
from tca_wire.packets.resources import SetVariable as SetVariable
from tca_wire.packets.resources import Unlock as Unlock
from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import Condition, Outcome, Refusal, Scope

PROTOCOL_VERSION = 8
"""Goes up whenever a header changes. Central refuses a module with another version, and says so."""


# --- from a module --------------------------------------------------------------------------------


class Hello(Numbered, frozen=True, forbid_unknown_fields=False, tag=1):
    """First header of a connection, and again after a reconnect. Answered by Welcome or Refused.

    Unknown fields are accepted, so that central can read the Hello of a later version and refuse
    it.
    """

    version: int
    module: str
    incarnation: str
    """The id of one run of a module, shared by all its connections."""
    connection: int = 0
    """The number of the module's connection: 0 is its own, the others handle messages."""
    resource: str = ""
    """The resource whose messages this connection handles, one at a time ("": none)."""
    process: str = ""
    """The module's process, for display: "host:pid"."""
    pulse: bytes = b""
    """Routing id of the socket on which this process echoes central's heartbeats, if it has one."""
    prefetch: int = 0
    """Number of messages that central may prefetch to this slot while it handles another."""
    hung_after: float = 0
    """Seconds after which central counts this slot as lost and sends Replace (0: never).

    They count from the time at which the slot's handler was asked to end, or the sender gave up.
    """
    cancels_on_leave: bool = False
    """When the module leaves, central requests the cancel of its living top-level tasks."""


class Register(Numbered, frozen=True, tag=2):
    """Declare messages, and name those that this module handles."""

    messages: Annotated[list[MessageFormat], MANY]
    handlers: Annotated[list[HandlerFormat], MANY] = []
    is_ready: bool = False
    """The module has made the attachments of its start.

    Central reports attachments of its earlier runs as stale if they were not made again.
    """


class Unregister(Numbered, frozen=True, tag=3):
    """Stop handling these messages; all messages if the list is empty."""

    messages: Annotated[list[str], MANY]


class Send(Numbered, frozen=True, tag=4):
    """Send a message of any class; the body is its data.

    Answered by Accepted or Refused, then by Answer where due.
    """

    message: str
    parent: TaskId = TaskId(0)
    """The parent of the new goal or command (0: the root)."""
    origin: int = 0
    flags: Flags = Flags.SEQ_ACH
    constraints: Annotated[list[Constraint], MANY] = []
    priority: int = 0
    blocking: bool = False
    """The sender's connection does nothing else until the answer arrives."""
    maximum: int = 0
    """The number of replies that a multi-query wants (0: one from every handler)."""
    attachments: Annotated[list[Attachment], MANY] = []
    """Exception handlers of the new task, oldest first."""
    deadline: float = 0
    """Seconds until the task must be achieved; later the failure "timeout" is raised (0: none)."""
    watch: WatchOptions | None = None
    """The options of a monitor."""
    when_killed: bool = False
    """Send it not now, but when *parent* is killed between its start and its achievement."""
    if_handled: bool = False
    """Send it only if a module handles it now; else Accepted has id 0 (TCA 8.5: MaybeExecute)."""
    keep: bool = False
    """The sender's module retains the task, as with Keep (TDL: PERSISTENT)."""
    brief: bool = False
    """The *blocking* wait is not checked for a deadlock: the sender's own limit ends it soon."""
    suspended: bool = False
    """The new task is created suspended by the sender: it does not start before it is resumed."""
    quiet: bool = False
    """TasksMade confirms the new task, with others, before the next answer of another kind."""
    retry: RetryPolicy | None = None
    """The retry policy of the new goal or command, in place of the declared one."""


class Reply(OfDelivery, frozen=True, tag=5):
    """The handler of a delivery returned; the body is its reply or result."""

    took: float = 0
    """Seconds that the handler ran, by the module's clock (0: unknown)."""
    refusals: int = 0
    """The number of refused *quiet* tasks that the handler knows of.

    If central has refused more, the delivery fails.
    """
    transition: str = ""
    """The transition by which the handler ends its task ("": the usual one)."""


class Postpone(OfDelivery, frozen=True, tag=61):
    """The handler of a delivery has returned. Its Reply or Fail comes later."""

    frees_slot: bool = False
    """The slot may handle any message from now on; otherwise only tasks below this delivery."""


class Replies(WireArray, frozen=True, tag=30):
    """Handlers of informs, queries or broadcasts have returned, one after the other.

    The body is their replies, joined.
    """

    ended: Annotated[list[EndedRun], MANY]
    begun: float = -1
    """Seconds since this slot started its next message (below 0: it has not)."""


class Fail(OfDelivery, frozen=True, tag=6):
    """The handler of a delivery failed; the body is the failure's data."""

    failure: str
    text: str = ""
    kinds: Annotated[list[str], MANY] = []
    """The more general failures of which this one is a kind, nearest first."""
    reissue: bool = False
    """The exception handler can't deal with the failure: search for one above it at once."""


class Recalled(WireArray, frozen=True, tag=29):
    """This slot returns prefetched messages that it has not started, and never starts them."""

    deliveries: Annotated[list[int], MANY]
    is_answer: bool = True
    """Whether it answers a Recall. Recalled deliveries that are not in this list have started."""


class Constrain(Numbered, frozen=True, tag=7):
    """Add constraints between points of existing tasks."""

    constraints: Annotated[list[Constraint], MANY]
    origin: int = 0


class AwaitPoint(Numbered, frozen=True, tag=8):
    """Answer when this point has been reached."""

    point: Point
    origin: int = 0
    blocking: bool = False
    """The sender's connection does nothing else until the answer arrives."""
    brief: bool = False
    """As in Send."""
    lends_slot: bool = False
    """A coroutine of the handler awaits the answer: its slot may handle the task meanwhile."""


class GiveUp(WireArray, frozen=True, tag=9):
    """Stop waiting for the answer to *request*. If that was a Lock, central releases its claim."""

    request: int
    number: int = 0
    """With a number, central answers this header: the text says why *request* had no answer.

    The text is "" if *request* had one. For a multi-query without replies, the Answer is the first
    failure, if any.
    """
    origin: int = 0


class Await(WireArray, frozen=True, tag=26):
    """The sender now waits for the answer to an earlier *request*, after which it had continued.

    The request is a query, a multi-query, a *quiet* task or an Observe. This header itself has no
    answer.
    """

    request: int
    blocking: bool = True
    """The sender's connection does nothing else while it waits. A coroutine does not block it."""
    origin: int = 0
    others: Annotated[list[int], MANY] = []
    """Further requests: the sender waits for the first answer to any of them."""
    brief: bool = False
    """As in Send; the wait for the reply of a query sent earlier is always brief."""
    seen: int = 0
    """The number of Observe answers that the sender has received (-1: it has stopped waiting).

    If more are on their way, the sender does not wait.
    """


class Kill(OfTask, frozen=True, tag=10):
    """Kill a task with all its descendants: now, or *delay* seconds after now or after a point."""

    why: str = ""
    scope: Scope = Scope.TASK
    after: Point | None = None
    delay: float = 0
    origin: int = 0


class Ask(Numbered, frozen=True, tag=11):
    """Query central about a topic. The answer has a MessagePack map as body."""

    topic: Literal["status", "modules", "messages", "tree", "variables", "load", "attached", "sent"]
    """"sent": the living top-level tasks that this module has sent."""


class Receipt(WireArray, frozen=True, tag=50):
    """This connection has read packets of *size* bytes, without heartbeats, since the last receipt.

    Central limits the unread bytes for each connection.
    """

    size: int
    answers: Annotated[list[int], MANY] = []
    """Requests whose answers had large data and are read: central need not store them any more."""


class UsesStore(WireArray, frozen=True, tag=67):
    """This module shares memory with central: it has read the key in the folder ``Welcome.store``.

    Until central has this header, it sends the bytes behind each handle.
    """


class Bye(WireArray, frozen=True, tag=12):
    """This connection closes; no delivery fails."""

    error: str = ""
    """The error that ended the program; "" if it ended regularly."""


class Attach(Numbered, frozen=True, tag=13):
    """Attach an exception handler to one task, or to all tasks of a message.

    Answered by Accepted with the id for Remove.
    """

    attachment: Attachment
    task: TaskId = TaskId(0)
    """The task that it is attached to, where *message* is "" (0: the root, above all tasks)."""
    message: str = ""
    origin: int = 0


class Remove(Numbered, frozen=True, tag=14):
    """Remove an exception handler, or the sender's share in a wiretap.

    With *for_all* the wiretap is removed for all modules, or the monitor with this id ends.
    Accepted has id 0 if nothing with this id exists.
    """

    id: int
    for_all: bool = False
    origin: int = 0


class Raise(OfTask, frozen=True, tag=15):
    """Raise a failure on a task; the body is the failure's data."""

    failure: str
    text: str = ""
    kinds: Annotated[list[str], MANY] = []
    origin: int = 0


class Retry(OfTask, frozen=True, tag=16):
    """Kill all descendants of a task and handle it again. With *new_data* the body is its data."""

    new_data: bool = False
    origin: int = 0


class Resolve(Numbered, frozen=True, tag=55):
    """The exception handler with delivery *origin* resolves its failure, unless it fails itself."""

    origin: int


class Suspend(OfTask, frozen=True, tag=17):
    """Start neither a task nor its descendants from now on; with *resume*, start them again."""

    resume: bool = False
    origin: int = 0


class Deadline(Numbered, frozen=True, tag=18):
    """Raise the failure "timeout" on a task if it misses a point within *seconds* from now."""

    point: Point
    seconds: float
    origin: int = 0


class Inspect(OfTask, frozen=True, tag=19):
    """Query central about a task and its relatives. The answer is a MessagePack list of maps."""

    relation: Literal["self", "parent", "children", "ancestors", "descendants", "kept"]
    message: str = ""
    """Only tasks of this message ("": of any)."""


class Tap(Numbered, frozen=True, tag=64):
    """Send *listener* with the tapped data whenever the condition holds for a message or a task.

    Answered by Accepted with the id for Remove.
    """

    condition: Condition
    listener: str
    message: str = ""
    task: TaskId = TaskId(0)
    """The tapped task, where *message* is ""."""
    watch: WatchOptions | None = None
    """The options of a listener that is a monitor."""
    origin: int = 0
    at_once: bool = False
    """If the tapped event has happened already, send the listener now rather than refuse it."""
    of: str = ""
    """With *at_once*: the message of *task*, which may have ended."""


class Fire(Numbered, frozen=True, tag=65):
    """Fire a monitor, or all watching monitors of *message* (TCM: Activate).

    A demon monitor sends its action with the body as data; others test their condition now.
    Accepted has the id of the monitor (with *message*: of the oldest), or 0 if none was watching.
    """

    monitor: TaskId
    action: str = ""
    """The message that the data fits; the monitor must have this action ("": not checked)."""
    origin: int = 0
    message: str = ""
    """Fire all watching monitors of this message, instead of one *monitor*."""


class EndMonitor(Numbered, frozen=True, tag=66):
    """End a monitor; messages that it has sent continue."""

    monitor: TaskId
    origin: int = 0


class Keep(OfTask, frozen=True, tag=25):
    """Retain a task's data, outcome and place after its end; with *release*, no longer."""

    release: bool = False
    origin: int = 0


class AwaitAny(OfDelivery, frozen=True, tag=27):
    """The coroutine that handles a delivery waits until one of these requests is answered.

    This replaces the coroutine's earlier AwaitAny. With no requests the coroutine may continue.
    """

    requests: Annotated[list[int], MANY]


class WaitUntilHandled(Numbered, frozen=True, tag=22):
    """Answer when all these messages have handlers at the same time.

    Before that, an Answer with *more* and a text may warn.
    """

    messages: Annotated[list[str], MANY]
    promised: Annotated[list[str], MANY] = []
    """The messages that the sender will handle once the others have handlers."""
    origin: int = 0


class GoOn(Numbered, frozen=True, tag=54):
    """Start tasks again after a restart of central, without waiting for missing connections."""


class EndCentral(Numbered, frozen=True, tag=56):
    """End central, and with it this connection. With *keep* the run continues at the next start."""

    keep: bool = False


_OfRuns = WaitUntilHandled | GoOn | EndCentral
_OfConnections = Hello | Register | Unregister | Bye | Receipt | UsesStore | Ask
_OfMessages = Send | Reply | Replies | Fail | Postpone | Recalled | GiveUp | Await | AwaitAny
_OfTasks = Constrain | AwaitPoint | Kill | Retry | Suspend | Deadline | Inspect | Keep
_OfStates = ChangeState | Observe
_OfFailures = Raise | Attach | Remove | Resolve
_OfMonitors = Tap | Fire | EndMonitor
_OfResources = Lock | Unlock | Release | GetVariable | SetVariable
ToCentral = (
    _OfRuns
    | _OfConnections
    | _OfMessages
    | _OfTasks
    | _OfStates
    | _OfFailures
    | _OfMonitors
    | _OfResources
)


# --- from central ---------------------------------------------------------------------------------


class Welcome(Numbered, frozen=True, tag=33):
    """The answer to Hello.

    *module* is the name by which the journal knows the module; *epoch* names this run of central.
    """

    version: int
    module: str
    epoch: str
    store: str = ""
    """The folder of shared memory for large data; "": central has none.

    Its file "key" holds *epoch*, if the module shares memory with central.
    """


class Accepted(Numbered, frozen=True, tag=34):
    """The request was accepted; *id* is the new task or message (0: neither)."""

    id: int = 0


class TasksMade(WireArray, frozen=True, tag=45):
    """The *quiet* requests accepted since the last such header, with the tasks that they became."""

    tasks: list[tuple[int, TaskId]]


class Refused(Numbered, frozen=True, tag=35):
    """The request was refused and had no effect."""

    refusal: Refusal
    text: str


class Answer(Numbered, frozen=True, tag=36):
    """The answer to a query or wait; the body is the reply, result or failure data."""

    outcome: Outcome = Outcome.DONE
    failure: str = ""
    text: str = ""
    more: bool = False
    """Further answers to a multi-query follow. The answer without *more* is the last one.

    The last answer has no body and is *done*. If all handlers failed, it is the first failure, and
    the first line of its text names all failures.
    """


class Deliver(OfDelivery, frozen=True, tag=37):
    """Handle this message and answer with Reply or Fail; the body is its data."""

    message: str
    task: TaskId = TaskId(0)
    """The id of the task (0: the message is not a task)."""
    context: Trouble | Tapped | Watching | None = None
    """The cause, if central made the message."""
    suspended: bool = False
    ahead: int = 0
    """The number of deliveries that the slot must handle before it, as far as central knows."""


class Cancelled(OfDelivery, frozen=True, tag=38):
    """The task of this delivery was killed or will be retried: its handler should end soon."""

    why: str = ""
    """The reason, and the requester of a kill."""


class Beat(WireArray, frozen=True, tag=39):
    """Central is alive."""


class Unknown(WireArray, frozen=True, tag=40):
    """Central does not know this connection: say Hello again and repeat unacknowledged requests."""

    number: int = 0
    """The request that central has not done. It is lost unless the module sends it again."""


class Closing(WireArray, frozen=True, tag=41):
    """Central ends."""

    text: str = ""


class Suspended(OfDelivery, frozen=True, tag=42):
    """The task of this delivery was suspended or resumed: its handler may pause, or continue."""

    is_suspended: bool


class Taken(Numbered, frozen=True, tag=43):
    """The claim of the Lock with this number was revoked: *text* names the cause."""

    text: str


class Replace(Numbered, frozen=True, tag=51):
    """This slot is lost because its handler hangs: open another slot in its place."""

    text: str = ""


class Recall(WireArray, frozen=True, tag=44):
    """Return the named prefetched deliveries that have not started. Answered by Recalled."""

    deliveries: list[int]


_Answers = Welcome | Accepted | TasksMade | Refused | Answer | Unknown
_ToHandlers = Deliver | Recall | Cancelled | Suspended | Requested
_Notices = Beat | Closing | Taken | Replace
ToModule = _Answers | _ToHandlers | _Notices
