"""The facts that the journal records: one type each; the field order is the order on disk.

A fact says what happened, not what follows from it: tools fold facts and re-run no rule.

Each message that central accepts has an *id* from one counter. The id of a goal or command is also
that of its task. A delivery has the id of its message, with two exceptions: each receiver's copy of
a broadcast or multi-query, and each repeated handling of a task, has an id of its own.
"""

from typing import Annotated

import msgspec

from tca_wire.constraints import Constraint
from tca_wire.journal.causes import Cause
from tca_wire.journal.fact import BaseFact, MonitorFact, NumberedFact, TaskFact, WaitFact
from tca_wire.journal.run_facts import CentralEnding as CentralEnding
from tca_wire.journal.run_facts import CentralFailed as CentralFailed
from tca_wire.journal.run_facts import CentralRestarted as CentralRestarted
from tca_wire.journal.run_facts import Closed as Closed
from tca_wire.journal.run_facts import DiskSpace as DiskSpace
from tca_wire.journal.run_facts import MembersChanged as MembersChanged
from tca_wire.journal.run_facts import Opened as Opened
from tca_wire.journal.run_facts import Shortened as Shortened
from tca_wire.journal.run_facts import WentOn as WentOn
from tca_wire.points import ROOT, Point, TaskId
from tca_wire.vocabulary import (
    CENTRAL,
    Condition,
    Dropping,
    MessageClass,
    Outcome,
    Party,
    Refusal,
    Role,
    Scope,
)

JOURNAL_VERSION = 6
"""Goes up whenever a fact or an entry changes. Older journals than ``OLDEST_READ`` are refused."""
OLDEST_READ = 4
LONGEST_TIME = 1e12  # seconds, 30,000 years: no entry is later
EntryNumber = Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)]
EntryTime = Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_TIME)]


# --- modules --------------------------------------------------------------------------------------


class ModuleJoined(BaseFact, frozen=True, tag="module joined"):
    """A module said hello; *module* is its name, made unique among those connected."""

    module: str
    process: str
    principal: str = ""
    """The owner: the name of a key, "uid:N" for another user, "" for the user of central."""


class ModuleLeft(BaseFact, frozen=True, tag="module left"):
    """A module said goodbye, or was *lost*; *why* is for display."""

    module: str
    why: str
    lost: bool = False


class KeysChanged(BaseFact, frozen=True, tag="keys"):
    """These keys may connect from now on, and these may no longer."""

    allowed: list[str]
    revoked: list[str]


class PermissionsChanged(BaseFact, frozen=True, tag="permissions"):
    """The permissions are now *rules* rules of *source* (-1: no rules, everything is allowed)."""

    rules: int
    source: str


class ResourceChanged(BaseFact, frozen=True, tag="resource"):
    """A resource of a module now handles up to *capacity* messages at a time."""

    module: str
    resource: str
    capacity: int


class Recalling(BaseFact, frozen=True, tag="recalling"):
    """A slot is asked to return prefetched messages, or (*is_over*) has answered or left. In the
    meantime its resource accepts no message.
    """

    module: str
    resource: str
    is_over: bool = False


class FormatDefined(BaseFact, frozen=True, tag="format"):
    """The first declaration of a message. *data* and *reply* are formats, as JSON Schema."""

    message: str
    message_class: MessageClass
    data: str
    reply: str
    module: str
    life_cycle: str = ""
    """The table of its tasks' life cycle ("": the general one)."""


class HandlerAdded(BaseFact, frozen=True, tag="handler"):
    """A module now handles a message, in this resource."""

    message: str
    module: str
    resource: str
    accepts: bool = False
    """The handler itself accepts or rejects each task."""


class HandlerRemoved(BaseFact, frozen=True, tag="no handler"):
    """A module no longer handles a message."""

    message: str
    module: str


class RequestRefused(BaseFact, frozen=True, tag="refused"):
    """A request was refused. *sender* is the module, or "?" before its hello."""

    sender: str
    refusal: Refusal
    text: str


class Ignored(BaseFact, frozen=True, tag="ignored"):
    """A request changed nothing: it was no longer possible, and the module could not know that."""

    sender: str
    text: str


# --- messages on their way ------------------------------------------------------------------------


class Received(NumberedFact, frozen=True, tag="received"):
    """Central accepted a message; a goal or command becomes a new task under *parent*.

    *origin* is the delivery whose handler sent it (0: none). If *blocking*, the sender does
    nothing else until the answer comes, or until the sender gives up.
    """

    message: str
    message_class: MessageClass
    sender: str
    parent: TaskId
    origin: int
    blocking: bool
    body: bytes
    constraints: list[Constraint]
    role: Role = Role.NONE
    about: int = 0
    """Of a message of central: the failing, tapped, killed or monitoring task."""


class Queued(NumberedFact, frozen=True, tag="queued"):
    """A delivery of message *message_id* waits for a busy *resource*, or ("") for any handler."""

    message_id: int
    module: str
    resource: str
    priority: int = 0


class Unqueued(NumberedFact, frozen=True, tag="unqueued"):
    """A delivery left its queue, and no handler got it.

    Its task is held again, suspended or killed, its sender gave up, or its handler left.
    """


class Delivered(NumberedFact, frozen=True, tag="delivered"):
    """A delivery of message *message_id* was sent to a handler."""

    message_id: int
    module: str
    resource: str
    slot: int = 0
    """The number of the resource's slot that has it, from 1."""
    is_nested: bool = False
    """Whether the slot handles it while the slot's other message waits."""
    priority: int = 0
    began: float = 0
    """The time at which its handler started, if before this entry: the message was prefetched."""


class Postponed(NumberedFact, frozen=True, tag="postponed"):
    """The handler of a delivery has returned, and replies later."""

    frees_slot: bool = False
    """Whether its slot handles any message, not only tasks below it."""


class Returned(NumberedFact, frozen=True, tag="returned"):
    """The handler of a delivery ended; the body is its reply or result, or its failure's data."""

    outcome: Outcome
    body: bytes
    ended: float = 0
    """The time of that end, if before this entry: a slot may report several ends together."""
    transition: str = ""
    """The transition by which the handler ends its task ("": the usual one)."""


class Answered(NumberedFact, frozen=True, tag="answered"):
    """The sender of a message got its (last) answer."""


class Dropped(NumberedFact, frozen=True, tag="dropped"):
    """A message was dropped, or one receiver's copy of message *copy_of*; *why* is for display."""

    message: str
    why: str
    copy_of: int = 0
    where: str = ""
    """The place of a query when its sender gave up."""
    dropping: Dropping = Dropping.OTHER


# --- tasks ----------------------------------------------------------------------------------------


class Constrained(BaseFact, frozen=True, tag="constrained"):
    """Constraints were added between tasks that existed."""

    constraints: list[Constraint]


class TimedOut(BaseFact, frozen=True, tag="timed out"):
    """A constraint no longer holds a task: its delay is over, or will never begin."""

    constraint: Constraint


class Reached(TaskFact, frozen=True, tag="reached"):
    """A task reached *moments*: the sum of their numbers."""

    moments: int


class Killed(TaskFact, frozen=True, tag="killed"):
    """A task was killed. It ends when its handler, if one runs, has returned.

    *by* is, here and below, the module that asked for it, or "central".
    """

    why: str
    by: str = CENTRAL
    origin: int = 0
    """The delivery whose handler asked for it, perhaps long before (0: none)."""
    failed: TaskId = ROOT
    """The task whose unhandled failure is the reason (0: another reason)."""


class KillPlanned(TaskFact, frozen=True, tag="to be killed"):
    """A kill of the tasks in *scope* is planned: *seconds* after point *after* (None: from now)."""

    scope: Scope
    after: Point | None
    seconds: float
    why: str
    by: str


class SendPlanned(TaskFact, frozen=True, tag="to be sent"):
    """A message will be sent if a task is killed after its start: to leave things safe."""

    message: str
    body: bytes


class DeadlineSet(TaskFact, frozen=True, tag="deadline"):
    """The failure "timeout" is raised on a task if it does not reach *moment* within *seconds*."""

    moment: int
    seconds: float


class SuspendedOrResumed(TaskFact, frozen=True, tag="suspended"):
    """A task was suspended or resumed, with all its descendants."""

    is_suspended: bool
    by: str = CENTRAL


class StateChanged(TaskFact, frozen=True, tag="state"):
    """A transition of a task's life cycle that no other fact implies.

    A retry and the task's end imply transitions, and so does a delivery, unless the handler itself
    accepts tasks (*accepts* of the fact "handler").
    """

    transition: str
    state: str
    serial: int
    """The number of all changes of this task's state, this one included."""
    by: Party
    module: str = ""
    text: str = ""
    """The reason, for display."""
    body: bytes = b""
    """The goal that a client asks for, or an intermediate result. For an accepted update: the goal,
    if it is not the newest one that clients have asked for.
    """


class Kept(TaskFact, frozen=True, tag="kept"):
    """A module retains a task: its data, outcome and place are remembered after its end."""

    module: str


class Released(TaskFact, frozen=True, tag="released"):
    """*module* no longer retains a task; or ("") its record is removed."""

    module: str


# --- waits and locks ------------------------------------------------------------------------------


class Awaited(NumberedFact, frozen=True, tag="awaited"):
    """The sender of a query or multi-query had continued, and now waits for the answer."""


class WaitBegan(WaitFact, frozen=True, tag="wait began"):
    """A module waits for a *moment* or change of a task, or for handlers of messages (*name*)."""


class WaitEnded(WaitFact, frozen=True, tag="wait ended"):
    """A wait ended. The moment is not recorded."""


class Claimed(NumberedFact, frozen=True, tag="claimed"):
    """A module waits to lock or (*is_reserved*) reserve a resource, in delivery *origin* (or 0)."""

    module: str
    resource: str
    is_reserved: bool
    sender: str
    origin: int


class Granted(NumberedFact, frozen=True, tag="granted"):
    """A resource is locked, or reserved, from now on."""


class ClaimEnded(NumberedFact, frozen=True, tag="claim ended"):
    """A lock or reservation ended, or the wait for it."""

    why: str


# --- failures and exception handlers --------------------------------------------------------------


class Failed(NumberedFact, frozen=True, tag="failed"):
    """A failure was raised on a task or message, or on one receiver's copy of message *copy_of*.

    If the module was lost, no fact "returned" follows: this fact ends the handling.

    If *is_beside*, the handler did not raise the failure, and continues. Then *by* is the module
    that raised the failure, or "central", and *body* is the failure's data.
    """

    failure: str
    text: str
    is_beside: bool = False
    by: str = ""
    body: bytes = b""
    copy_of: int = 0


class Attached(NumberedFact, frozen=True, tag="attached"):
    """Exception handler *handler* is attached to a task, or to all tasks of a message.

    It is for one *failure* ("": any), at most *maximum* times (0: no limit).
    """

    failure: str
    handler: str
    task: TaskId
    message: str
    maximum: int


class Removed(NumberedFact, frozen=True, tag="removed"):
    """An exception handler or wiretap was removed."""

    by: str


class Caught(TaskFact, frozen=True, tag="caught"):
    """Task *handler* handles the failure of a task. Its *attachment* was made to task *at*."""

    handler: TaskId
    at: TaskId
    attachment: int
    is_beside: bool = False
    """Whether the failure was raised beside the task's handler, which continues."""


class Reissued(BaseFact, frozen=True, tag="reissued"):
    """An exception handler passed on its failure; the search for another one continues."""

    handler: TaskId


class Resolved(BaseFact, frozen=True, tag="resolved"):
    """An exception handler has resolved its failure. This counts unless the handler fails."""

    handler: TaskId


class NotResolved(BaseFact, frozen=True, tag="not resolved"):
    """An exception handler's task ended and left its failure as it was; the search continues."""

    handler: TaskId
    task: TaskId


class Unhandled(TaskFact, frozen=True, tag="unhandled"):
    """No exception handler dealt with a failure: the top-level task above it fails."""

    undecided: TaskId = ROOT
    """The exception handler that failed and so decided nothing; it is killed (0: none)."""


class Recovered(TaskFact, frozen=True, tag="recovered"):
    """*handler* has dealt with the failure of a task: the task counts as handled."""

    handler: TaskId = ROOT


class Retried(TaskFact, frozen=True, tag="retried"):
    """A task will be handled again when its descendants have ended. A body is new data."""

    body: bytes
    by: str
    failed: TaskId = ROOT
    """The failing task, if a retry policy deals with the failure."""
    pause: Constraint | None = None
    """The delay that the policy puts before the retry."""
    fallback: str = ""
    """The message that replaces the task now, instead of another handling."""


# --- wiretaps and monitors ------------------------------------------------------------------------


class TapAdded(NumberedFact, frozen=True, tag="tap"):
    """A wiretap was added: it sends *listener* when *condition* happens to a message or task."""

    condition: Condition
    listener: str
    message: str
    task: TaskId
    by: str


class TapFired(BaseFact, frozen=True, tag="tapped"):
    """A wiretap sent its listener as message *listener* (0: not sent, as it has no handler)."""

    tap: int
    tapped: int
    listener: int


class WaitedFor(MonitorFact, frozen=True, tag="waited for"):
    """A parent waits for a polling or demon monitor: it is not a background monitor."""


class OutlivesRetry(MonitorFact, frozen=True, tag="spared"):
    """A retry of the task above spares a monitor that the task's handler did not create."""


class MonitorTested(MonitorFact, frozen=True, tag="tested"):
    """The condition of a monitor was tested."""

    holds: bool


class MonitorEnded(MonitorFact, frozen=True, tag="monitor ended"):
    """A monitor stopped watching."""

    why: str


_OfRuns = (
    Opened
    | Shortened
    | Closed
    | DiskSpace
    | MembersChanged
    | CentralFailed
    | CentralRestarted
    | WentOn
)
_OfModules = ModuleJoined | ModuleLeft | ResourceChanged | Recalling
_OfDeclarations = FormatDefined | HandlerAdded | HandlerRemoved
_OfAccess = KeysChanged | PermissionsChanged | RequestRefused | Ignored | CentralEnding
_OfMessages = Received | Queued | Unqueued | Delivered | Postponed | Returned | Answered | Dropped
_OfTasks = Constrained | TimedOut | Reached | Killed | KillPlanned | SendPlanned | DeadlineSet
_OfStates = SuspendedOrResumed | StateChanged | Kept | Released | Recovered | Retried
_OfWaits = Awaited | WaitBegan | WaitEnded | Claimed | Granted | ClaimEnded
_OfFailures = Failed | Attached | Removed | Caught | Reissued | Resolved | NotResolved | Unhandled
_OfMonitors = TapAdded | TapFired | WaitedFor | OutlivesRetry | MonitorTested | MonitorEnded
Fact = (
    _OfRuns
    | _OfModules
    | _OfDeclarations
    | _OfAccess
    | _OfMessages
    | _OfTasks
    | _OfStates
    | _OfWaits
    | _OfFailures
    | _OfMonitors
)


class Entry(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All facts of one cause; without a cause central itself starts or ends a segment.

    *time* is in seconds since the epoch began, on a monotonic clock.
    """

    number: EntryNumber
    time: EntryTime
    facts: list[Fact]
    cause: Cause | None = None


def kind_of(fact: Fact | type[Fact]) -> str:
    """Return the word for a fact's kind, for display: "received"."""
    tag = str(fact.__struct_config__.tag)
    return "delay over" if tag == "timed out" else tag  # "timed out" would suggest a failure
