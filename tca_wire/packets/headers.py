"""The headers that modules and central exchange, one type a message; the field order is the wire
order.

A header travels with a body of opaque bytes (user data as MessagePack; central never looks inside).
Types named in the imperative are sent by a module, the others by central; routes.py has those about
direct messages, changes.py those about the states of tasks, docs/protocol.md the bytes. ``number``
counts a connection's requests: the answer to a request carries the same number, and 0 means that no
answer is wanted. ``origin`` is the delivery whose handler asks (0:
code outside of handlers does). A task below -1 is the one that this connection has sent with that
request: -7 is that of request 7.
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
    Tapped,
    Trouble,
    Watching,
    WatchOptions,
    WireArray,
)
from tca_wire.packets.routes import Barred, Entrance, EntranceGone, Noted, Route, WatchEntrance
from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import Condition, Outcome, Refusal, Scope

PROTOCOL_VERSION = 7
"""Goes up whenever a header changes: who speaks another one is refused, and told so."""


# --- from a module --------------------------------------------------------------------------------


class Hello(Numbered, frozen=True, forbid_unknown_fields=False, tag=1):
    """First message of a connection, and again after a reconnect. Answered by Welcome or Refused. A
    later version's may have more fields: so it can be read, and refused for its version.
    """

    version: int
    module: str
    incarnation: str
    """The id of one run of a module, shared by all its connections."""
    connection: int = 0
    """The module's connection: 0 is its own, the others handle messages."""
    resource: str = ""
    """The resource whose messages this connection handles, if any: one at a time."""
    process: str = ""
    """The module's process, for people: "host:pid"."""
    entrance: Entrance | None = None
    """This slot's entrance for direct messages, if it takes any."""
    pulse: bytes = b""
    """Routing id of the socket on which this process sends back central's beats, if it has one."""
    prefetch: int = 0
    """Number of messages that this slot takes ahead, before it has handled the one it has."""
    hung_after: float = 0
    """Seconds after which a handler hangs that was to end, or whose sender has given up: then this
    slot counts as lost, and the module gets Replace (0: never).
    """


class Register(Numbered, frozen=True, tag=2):
    """Declare messages, and say which of them this module handles."""

    messages: Annotated[list[MessageFormat], MANY]
    handlers: Annotated[list[HandlerFormat], MANY] = []
    is_ready: bool = False
    """The module has attached what it attaches at its start: what its earlier runs attached besides
    is left behind.
    """


class Unregister(Numbered, frozen=True, tag=3):
    """This module handles these messages no longer (all of its handlers when the list is empty)."""

    messages: Annotated[list[str], MANY]


class Send(Numbered, frozen=True, tag=4):
    """Send a message of any class; the body is its data. Answered by Accepted or Refused, then by
    Answer where due.
    """

    message: str
    parent: TaskId = TaskId(0)
    """The task that a goal or command becomes a child of (0: the root)."""
    origin: int = 0
    flags: Flags = Flags.SEQ_ACH
    constraints: Annotated[list[Constraint], MANY] = []
    priority: int = 0
    blocking: bool = False
    """The sender's connection does nothing else until the answer is there."""
    maximum: int = 0
    """The number of replies that a multi-query wants (0: from every handler)."""
    attachments: Annotated[list[Attachment], MANY] = []
    """Exception handlers of the new task, each newer than the one before it."""
    deadline: float = 0
    """Seconds within which the task must be achieved, or the failure "timeout" is raised on it (0:
    no such bound).
    """
    watch: WatchOptions | None = None
    """The options of a monitor."""
    when_killed: bool = False
    """Not now, but when *parent* is killed after it has been started and before it is achieved."""
    if_handled: bool = False
    """Only if somebody handles the message now; else the answer is Accepted with id 0 (TCA 8.5:
    MaybeExecute).
    """
    keep: bool = False
    """The sender's module keeps the task, as with Keep (TDL: PERSISTENT)."""
    brief: bool = False
    """The *blocking* wait is too short to be checked for a deadlock."""
    suspended: bool = False
    """The new task is suspended from its birth on, by the sender: it is not started before it is
    resumed.
    """
    quiet: bool = False
    """Of a task: instead of Accepted comes TasksMade, with others and at the latest before the next
    other answer.
    """


class Reply(OfDelivery, frozen=True, tag=5):
    """The handler of a delivery returned; the body is its reply or result."""

    took: float = 0
    """Seconds that it ran, by its own clock (0: not said)."""
    refusals: int = 0
    """How many refusals of *quiet* tasks that it has sent the handler knows: if there were more, it
    has failed.
    """


class Replies(WireArray, frozen=True, tag=30):
    """Handlers of informs, queries or broadcasts have returned, one after the other; what they
    returned is the body, end to end.
    """

    ended: Annotated[list[EndedRun], MANY]
    begun: float = -1
    """How long ago this slot began with what comes after these (below 0: it has not)."""


class Fail(OfDelivery, frozen=True, tag=6):
    """The handler of a delivery failed; the body is the failure's data."""

    failure: str
    text: str = ""
    kinds: Annotated[list[str], MANY] = []
    """The more general failures that this one is a kind of, nearest first."""
    reissue: bool = False
    """The handler of a failure cannot deal with it: search on, above it, at once."""


class Recalled(WireArray, frozen=True, tag=29):
    """This slot gives back what it had ahead and had not begun: it never begins it."""

    deliveries: Annotated[list[int], MANY]
    is_answer: bool = True
    """To a Recall: what that named, and is not given back, has been begun."""


class Constrain(Numbered, frozen=True, tag=7):
    """Add constraints between points of existing tasks."""

    constraints: Annotated[list[Constraint], MANY]
    origin: int = 0


class AwaitPoint(Numbered, frozen=True, tag=8):
    """Answer when this point has been reached."""

    point: Point
    origin: int = 0
    blocking: bool = False
    """The sender's connection does nothing else until the answer is there."""
    brief: bool = False
    """As in Send."""


class GiveUp(WireArray, frozen=True, tag=9):
    """The sender no longer waits for the answer to request *request*; if that was a Lock, its claim
    is released.
    """

    request: int
    number: int = 0
    """With a number it is answered: the text of the Answer says why that answer is not there ("":
    it is, or was). Of a multi-query to which nobody has replied it is the first failure, if there
    was one.
    """
    origin: int = 0


class Await(WireArray, frozen=True, tag=26):
    """The sender of query or multi-query *request*, who went on, now waits for its answer; or that
    of a *quiet* task for its id; or that of Observe for news. Nothing else answers this.
    """

    request: int
    blocking: bool = True
    """The sender's connection does nothing else meanwhile; a coroutine lets it do other things."""
    origin: int = 0
    others: Annotated[list[int], MANY] = []
    """Further requests: the sender waits for the first answer to any of them."""
    brief: bool = False
    """As in Send; a query that was fetched late is always waited for like that."""
    seen: int = 0
    """The number of answers that the sender has got to these, as far as they are Observe: if there
    are more on their way, it does not wait. -1: it waits no longer.
    """


class Kill(OfTask, frozen=True, tag=10):
    """End a task and everything under it: now, *delay* seconds from now, or *delay* seconds after a
    point.
    """

    why: str = ""
    scope: Scope = Scope.TASK
    after: Point | None = None
    delay: float = 0
    origin: int = 0


class Ask(Numbered, frozen=True, tag=11):
    """Ask central about a topic; answered with a MessagePack map as body."""

    topic: Literal["status", "modules", "messages", "tree", "variables", "load", "attached"]


class Receipt(WireArray, frozen=True, tag=50):
    """This connection has read so many bytes of packets, beats left out, since it said so last:
    central sends nobody more than so much that was not read.
    """

    size: int


class Bye(WireArray, frozen=True, tag=12):
    """This connection closes: of its own will, nothing failed."""


class Attach(Numbered, frozen=True, tag=13):
    """Let an exception handler take care of a failure ("": any) of one task, or of every task of a
    message. Answered by Accepted with the id by which it can be removed.
    """

    attachment: Attachment
    task: TaskId = TaskId(0)
    """The task that it is attached to, where *message* is "" (0: the root, above all tasks)."""
    message: str = ""
    origin: int = 0


class Remove(Numbered, frozen=True, tag=14):
    """Take away an exception handler, wiretap or (*for all*) a monitor, whoever wants it. Accepted:
    0 if it is gone.
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
    """Kill all under a task and let it be handled again, with the body as its data where
    *new_data*.
    """

    new_data: bool = False
    origin: int = 0


class Resolve(Numbered, frozen=True, tag=55):
    """The exception handler with the delivery *origin* has dealt with its failure, if its task ends
    without one.
    """

    origin: int


class Suspend(OfTask, frozen=True, tag=17):
    """From now on nothing under a task, and not the task itself, is started; or, with *resume*, may
    be again.
    """

    resume: bool = False
    origin: int = 0


class Deadline(Numbered, frozen=True, tag=18):
    """Raise the failure "timeout" on a task if its point is not reached within *seconds* from
    now.
    """

    point: Point
    seconds: float
    origin: int = 0


class Inspect(OfTask, frozen=True, tag=19):
    """Ask central about a task and its relatives; answered with a MessagePack list of maps."""

    relation: Literal["self", "parent", "children", "ancestors", "descendants", "kept"]
    message: str = ""
    """Only tasks of this message ("": of any)."""


class Lock(Numbered, frozen=True, tag=23):
    """Let nobody into a resource, or (*reserve*) only what this module sends. Answered when that is
    so.

    It ends when this request is given up, when the task or message *origin* has ended, or with the
    connection.
    """

    resource: str
    module: str = ""
    """The resource's module; "" if only one has a resource of that name."""
    reserve: bool = False
    origin: int = 0
    timeout: float = -1
    """After so many seconds of waiting the answer is the failure "timeout" (negative: never)."""
    priority: int = 0
    blocking: bool = False
    """The sender's connection does nothing else until the answer is there."""
    brief: bool = False
    """As in Send."""


class Unlock(Numbered, frozen=True, tag=24):
    """Take a lock or reservation from whoever has it. Answered by Accepted; its id is 0 if nobody
    had it.
    """

    resource: str
    module: str = ""
    origin: int = 0


class Tap(Numbered, frozen=True, tag=64):
    """Send *listener* whenever the condition comes true of a message, or of one task; it gets the
    tapped data.

    Answered by Accepted with the id by which the wiretap can be removed.
    """

    condition: Condition
    listener: str
    message: str = ""
    task: TaskId = TaskId(0)
    """The task that is tapped, where *message* is ""."""
    watch: WatchOptions | None = None
    """The options of a listener that is a monitor."""
    origin: int = 0
    at_once: bool = False
    """Where what *task* is tapped for has happened already, send the listener now; else that is
    refused.
    """
    of: str = ""
    """With *at_once*: the message that *task* is, for it may have ended."""


class Fire(Numbered, frozen=True, tag=65):
    """Fire a monitor, or all that watch of *message* (TCM: Activate). A demon monitor sends its
    action, the body is the data of that; any other tests its condition now.

    Answered by Accepted; its id is 0 if the monitor did not watch, and nothing was done; of a
    message the oldest that did.
    """

    monitor: TaskId
    action: str = ""
    """The message that the data are for; refused if that is not the monitor's action ("": it is not
    asked).
    """
    origin: int = 0
    message: str = ""
    """All that watch of this message, instead of one *monitor*."""


class EndMonitor(Numbered, frozen=True, tag=66):
    """End a monitor; messages that it has sent go on."""

    monitor: TaskId
    origin: int = 0


class Keep(OfTask, frozen=True, tag=25):
    """Remember a task after its end: data, outcome and place in the tree; or, with *release*, no
    longer.
    """

    release: bool = False
    origin: int = 0


class AwaitAny(OfDelivery, frozen=True, tag=27):
    """The handler of a delivery, a coroutine, does nothing until one of these requests is answered;
    it was said before what it awaited, and that is no longer so. With no requests: it may go on.
    """

    requests: Annotated[list[int], MANY]


class Release(Numbered, frozen=True, tag=28):
    """The sender no longer needs what Lock *request* has got. The id that Accepted names is 0 if it
    had lost that.
    """

    request: int
    origin: int = 0


class GetVariable(Numbered, frozen=True, tag=20):
    """Get the value of a variable, as the body of the Answer; it is empty if the variable was never
    set.
    """

    variable: str


class SetVariable(Numbered, frozen=True, tag=21):
    """Set a variable to the value in the body. Answered by Accepted or, with *swap*, as GetVariable
    was just before.
    """

    variable: str
    origin: int = 0
    swap: bool = False


class WaitUntilHandled(Numbered, frozen=True, tag=22):
    """Answer when each of these messages is handled by somebody, all at the same time. Before that
    an Answer with *more* and a text may come: a warning.
    """

    messages: Annotated[list[str], MANY]
    promised: Annotated[list[str], MANY] = []
    """The messages that the sender will handle as soon as all those are."""
    origin: int = 0


class GoOn(Numbered, frozen=True, tag=54):
    """Let tasks start again after a restart of central, whoever is not back yet."""


ToCentral = (
    Hello
    | Register
    | Unregister
    | Send
    | Reply
    | Fail
    | Constrain
    | AwaitPoint
    | GiveUp
    | Kill
    | Ask
    | Bye
    | Receipt
    | Attach
    | Remove
    | Raise
    | Retry
    | Resolve
    | Suspend
    | Deadline
    | Inspect
    | Tap
    | Fire
    | EndMonitor
    | GetVariable
    | SetVariable
    | WaitUntilHandled
    | Lock
    | Unlock
    | Keep
    | Await
    | AwaitAny
    | Release
    | Noted
    | WatchEntrance
    | Recalled
    | Replies
    | GoOn
    | ChangeState
    | Observe
)


# --- from central ---------------------------------------------------------------------------------


class Welcome(Numbered, frozen=True, tag=33):
    """Answers Hello. *module* is the name by which the journal knows the module; *epoch* names this
    run of central.
    """

    version: int
    module: str
    epoch: str


class Accepted(Numbered, frozen=True, tag=34):
    """The request was taken; *id* is the task or message it became (0: neither)."""

    id: int = 0


class TasksMade(WireArray, frozen=True, tag=45):
    """The *quiet* requests that were taken since the last such message, and the tasks that they
    became.
    """

    tasks: list[tuple[int, TaskId]]


class Refused(Numbered, frozen=True, tag=35):
    """The request was not taken, and nothing of it remains."""

    refusal: Refusal
    text: str


class Answer(Numbered, frozen=True, tag=36):
    """The answer to a query, a wait or a question; the body is the reply, result or failure
    data.
    """

    outcome: Outcome = Outcome.DONE
    failure: str = ""
    text: str = ""
    more: bool = False
    """Further answers to a multi-query follow; the one without *more* is the end. It has no body
    and is *done*, or is the first failure if all handlers failed: the first line of its text names
    them all.
    """


class Deliver(OfDelivery, frozen=True, tag=37):
    """Handle this message and answer with Reply or Fail; the body is its data."""

    message: str
    task: TaskId = TaskId(0)
    """The task that it is (0: it belongs to no tree)."""
    context: Trouble | Tapped | Watching | None = None
    """The reason for it, if central made it."""
    suspended: bool = False
    own: bool = False
    """A slot of its resource waits for the answer, and this one takes messages directly: handle it
    within another.
    """
    ahead: int = 0
    """So many deliveries, which are not answered yet as far as central knows, are to be handled
    before it.
    """


class Cancelled(OfDelivery, frozen=True, tag=38):
    """The task of this delivery has been killed, or is to be handled again: its handler should end
    soon.
    """

    why: str = ""
    """Why, and of a kill by whom."""


class Beat(WireArray, frozen=True, tag=39):
    """Central is alive."""


class Unknown(WireArray, frozen=True, tag=40):
    """Central does not know this connection: say Hello again, then repeat unacknowledged
    requests.
    """

    number: int = 0
    """The request that it answers, which is not done: if it was sent only once, nobody has it."""


class Closing(WireArray, frozen=True, tag=41):
    """Central ends."""

    text: str = ""


class Suspended(OfDelivery, frozen=True, tag=42):
    """The task of this delivery has been suspended, or resumed: its handler may hold, or go on to
    its end.
    """

    is_suspended: bool


class Taken(Numbered, frozen=True, tag=43):
    """The resource of the Lock with this number was taken away: *text* says by whom, or why."""

    text: str


class Replace(Numbered, frozen=True, tag=51):
    """The slot of this number is lost, for its handler hangs: open another one in its place."""

    text: str = ""


class Recall(WireArray, frozen=True, tag=44):
    """Give back those of these deliveries, which you have ahead, that you have not begun; answered
    by Recalled.
    """

    deliveries: list[int]


ToModule = (
    Welcome
    | Accepted
    | TasksMade
    | Refused
    | Answer
    | Deliver
    | Cancelled
    | Beat
    | Unknown
    | Closing
    | Suspended
    | Requested
    | Taken
    | Replace
    | Route
    | EntranceGone
    | Recall
    | Barred
)
