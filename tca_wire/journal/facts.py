"""The facts that the journal records: one type each; the field order is the order on disk.

A fact says what happened, never what follows from it: tools fold facts and re-run no rule. Every
message accepted by central has an *id* from one counter; a goal's or command's id is its task. A
*delivery* is one message on its way to one handler; its id is the message's own, except that each
receiver of a broadcast or multi-query has one of its own, and that a task which is handled again
has another one each time.
"""

from typing import Annotated

import msgspec

from tca_wire.constraints import Constraint
from tca_wire.journal.causes import Cause
from tca_wire.journal.fact import BaseFact, MonitorFact, NumberedFact, TaskFact
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
from tca_wire.waits import WaitKind

JOURNAL_VERSION = 6
"""Goes up whenever a fact or an entry changes. Journals of a version before ``OLDEST_READ`` are
refused.
"""
OLDEST_READ = 4
LONGEST_TIME = 1e12  # seconds, 30 000 years: no entry is later
EntryNumber = Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)]
EntryTime = Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_TIME)]


# --- the journal ----------------------------------------------------------------------------------


class Opened(BaseFact, frozen=True, tag="opened"):
    """A segment begins. *began* is wall-clock time (seconds since 1970) at which the entries' clock
    showed 0.
    """

    version: int
    epoch: str
    segment: int
    began: float
    central: str


class Shortened(BaseFact, frozen=True, tag="shortened"):
    """Facts were removed from the run's journal: those about tasks and messages that had ended
    *until* then.
    """

    until: float


class Closed(BaseFact, frozen=True, tag="closed"):
    """Central ended of its own will."""

    why: str


class CentralFailed(BaseFact, frozen=True, tag="broke"):
    """Central ended by an error of its own. The run may go on: then ``CentralRestarted``
    follows.
    """

    why: str


class CentralRestarted(BaseFact, frozen=True, tag="restarted"):
    """Central was away, and its clock stood still. No task starts before its connections are back
    or lost.
    """

    away: float  #: seconds of wall-clock time (0: not known)
    awaited: int  #: connections
    hold: bool = False  #: until somebody says so
    may_lack: bool = False  #: the last inputs before a power cut
    aside: int = 0  #: entries that the journal had of these


class WentOn(BaseFact, frozen=True, tag="went on"):
    """Tasks start again after a restart: all were back or lost, or a module said so."""

    by: str = ""


class DiskSpace(BaseFact, frozen=True, tag="disk"):
    """The disk of the journal is nearly full (*is low*): no new tasks are taken; or it has room
    again.
    """

    is_low: bool


# --- modules --------------------------------------------------------------------------------------


class ModuleJoined(BaseFact, frozen=True, tag="module joined"):
    """A module said hello; *module* is its name, made unique among those connected."""

    module: str
    process: str
    principal: str = ""
    """Who runs it: the name of a key, "uid:N" for another user of the computer, "" for the one who
    runs central.
    """


class ModuleLeft(BaseFact, frozen=True, tag="module left"):
    """A module said goodbye, or was *lost*; *why* is for people."""

    module: str
    why: str
    lost: bool = False


class KeysChanged(BaseFact, frozen=True, tag="keys"):
    """These keys may connect from now on, and these may no more."""

    allowed: list[str]
    revoked: list[str]


class PermissionsChanged(BaseFact, frozen=True, tag="permissions"):
    """From now on so many rules, from that source, say who may do what (-1: none do, everybody may
    do everything).
    """

    rules: int
    source: str


class ResourceChanged(BaseFact, frozen=True, tag="resource"):
    """A resource of a module now takes *capacity* messages at a time."""

    module: str
    resource: str
    capacity: int


class Recalling(BaseFact, frozen=True, tag="recalling"):
    """The slot of a resource is asked what it has ahead and has not begun, or (*is over*) has said
    so, or is gone. Nobody is let in meanwhile.
    """

    module: str
    resource: str
    is_over: bool = False


class FormatDefined(BaseFact, frozen=True, tag="format"):
    """The first declaration of a message (formats as JSON Schema)."""

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
    """It says itself when it accepts a task."""


class HandlerRemoved(BaseFact, frozen=True, tag="no handler"):
    """A module no longer handles a message."""

    message: str
    module: str


class RequestRefused(BaseFact, frozen=True, tag="refused"):
    """A request of a connection (a module's name or, before it said hello, "?") was refused."""

    sender: str
    refusal: Refusal
    text: str


class Ignored(BaseFact, frozen=True, tag="ignored"):
    """A request of a module changed nothing: it was no longer possible, and the module could not
    know that.
    """

    sender: str
    text: str


# --- messages on their way ------------------------------------------------------------------------


class Received(NumberedFact, frozen=True, tag="received"):
    """Central accepted a message; for a goal or command this is the birth of a task under *parent*.

    *origin* is the delivery that the sender was handling when it sent (0: none); *blocking* says
    that the sender does nothing until the answer comes, or until it gives up.
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
    """Of central's own messages: the failing, tapped, killed or monitoring task."""


class Queued(NumberedFact, frozen=True, tag="queued"):
    """A delivery of message *message_id* waits: for a resource that is busy, or for a handler
    (module, resource "").
    """

    message_id: int
    module: str
    resource: str
    priority: int = 0


class Unqueued(NumberedFact, frozen=True, tag="unqueued"):
    """A delivery waits no longer and nobody was given it: its task is held again, suspended or
    killed, its sender gave up, or the handler that had it left.
    """


class Delivered(NumberedFact, frozen=True, tag="delivered"):
    """A delivery of message *message_id* was sent to a handler."""

    message_id: int
    module: str
    resource: str
    slot: int = 0
    """The resource's slot that has it, from 1."""
    is_nested: bool = False
    """The slot has another message, and waits: this one is handled within that wait."""
    priority: int = 0
    began: float = 0
    """When its handler began, on the clock of the entries, if that was earlier: the slot had the
    message already.
    """


class Returned(NumberedFact, frozen=True, tag="returned"):
    """The handler of a delivery ended; the body is its reply or result, or the data of its
    failure.
    """

    outcome: Outcome
    body: bytes
    ended: float = 0
    """When that was, on the clock of the entries, if it was earlier: its slot tells of several
    together.
    """


class Answered(NumberedFact, frozen=True, tag="answered"):
    """The sender of a message got its (last) answer."""


class Dropped(NumberedFact, frozen=True, tag="dropped"):
    """A message came to nothing, or only what one receiver was to get: a copy of message *copy_of*.

    *why* is for people; *where* says, of a query whose sender gave up, where it was then.
    """

    message: str
    why: str
    copy_of: int = 0
    where: str = ""
    dropping: Dropping = Dropping.OTHER


class HandledDirectly(BaseFact, frozen=True, tag="direct"):
    """A module handled a message that came from its sender directly; central has seen nothing of it
    but this note.

    *origin* is the delivery whose handler sent it (0: none), *size* the bytes of its data; its
    handler ended at *ended* on the clock of the entries and took so many *seconds*.
    """

    message: str
    module: str
    resource: str
    sender: str
    origin: int
    size: int
    ended: float
    seconds: float
    outcome: Outcome
    failure: str


class LostDirectly(BaseFact, frozen=True, tag="direct lost"):
    """*module* reports that so many informs of *message* ("": notes of direct messages) were sent
    directly and lost. Where the module of their handler died, some may have been handled.
    """

    module: str
    message: str
    number: int


# --- tasks ----------------------------------------------------------------------------------------


class Constrained(BaseFact, frozen=True, tag="constrained"):
    """Constraints were added between tasks that existed."""

    constraints: list[Constraint]


class TimedOut(BaseFact, frozen=True, tag="timed out"):
    """A delay is over, or void since its point never came: what this constraint held back is held
    by it no longer.
    """

    constraint: Constraint


class Reached(TaskFact, frozen=True, tag="reached"):
    """A task reached moments (a bit mask, see points.Moment)."""

    moments: int


class Killed(TaskFact, frozen=True, tag="killed"):
    """A task was killed. It ends when its handler, if one runs, has returned. *by* is, here and
    below, the module that asked for it, or "central".
    """

    why: str
    by: str = CENTRAL
    origin: int = 0
    """The delivery whose handler asked for it, perhaps long before (0: none)."""
    failed: TaskId = ROOT
    """The task for whose failure central killed it, since nobody handled that (0: it has another
    reason).
    """


class KillPlanned(TaskFact, frozen=True, tag="to be killed"):
    """A task is to be killed, or what *scope* says, when *after* is reached (None: now) and so many
    seconds more.
    """

    scope: Scope
    after: Point | None
    seconds: float
    why: str
    by: str


class SendPlanned(TaskFact, frozen=True, tag="to be sent"):
    """A message is to be sent when a task is killed that has been started: to leave things safe."""

    message: str
    body: bytes


class DeadlineSet(TaskFact, frozen=True, tag="deadline"):
    """If a task does not reach a moment within so many seconds from now, the failure "timeout" is
    raised on it.
    """

    moment: int
    seconds: float


class SuspendedOrResumed(TaskFact, frozen=True, tag="suspended"):
    """A task was suspended or resumed, with all that is under it."""

    is_suspended: bool
    by: str = CENTRAL


class StateChanged(TaskFact, frozen=True, tag="state"):
    """A transition of a task's life cycle that no other fact tells of. Others do of its delivery to
    a handler, which accepts it thereby unless ``HandlerAdded.accepts``, of a retry, and of its end.
    """

    transition: str
    state: str
    serial: int
    """The number of all changes of this task's state, this one included."""
    by: Party
    module: str = ""
    text: str = ""
    """The reason, for people."""
    body: bytes = b""
    """The goal that a client asks for, the other one that its server takes over, or an intermediate
    result.
    """


class Kept(TaskFact, frozen=True, tag="kept"):
    """A module keeps a task: its data, outcome and place are remembered after its end."""

    module: str


class Released(TaskFact, frozen=True, tag="released"):
    """A module keeps a task no longer; or ("") its record is gone, for all."""

    module: str


# --- waits and locks ------------------------------------------------------------------------------


class Awaited(NumberedFact, frozen=True, tag="awaited"):
    """The sender of a query or multi-query, which had gone on, waits for its answer from now on."""


class _WaitFact(BaseFact, frozen=True):
    module: str
    origin: int
    task: TaskId
    moment: int = 0
    awaits: WaitKind = WaitKind.TASK
    name: str = ""

    @property
    def key(self) -> tuple[str, int, int, str, str]:
        """Who waits, and for what: the same at the beginning and at the end."""
        return self.module, self.origin, self.task, self.awaits, self.name


class WaitBegan(_WaitFact, frozen=True, tag="wait began"):
    """A handler (delivery *origin*; 0: none) waits for a *moment* of a task, its CHANGE, or for
    what *name* says.
    """


class WaitEnded(_WaitFact, frozen=True, tag="wait ended"):
    """Such a wait ended. Of what moment it was is not said."""


class Claimed(NumberedFact, frozen=True, tag="claimed"):
    """A module waits to lock a resource, or (*is_reserved*) to reserve it, in delivery *origin* (0:
    in none).
    """

    module: str
    resource: str
    is_reserved: bool
    sender: str
    origin: int


class Granted(NumberedFact, frozen=True, tag="granted"):
    """A resource is locked, or reserved, from now on."""


class ClaimEnded(NumberedFact, frozen=True, tag="claim ended"):
    """A resource is not locked or reserved any more, or is no longer waited for to be."""

    why: str


# --- failures and exception handlers --------------------------------------------------------------


class Failed(NumberedFact, frozen=True, tag="failed"):
    """A failure was raised on a task or message, or on what one receiver got: a copy of message
    *copy_of*.

    Of a module that was lost no handler returns: this ends its part. A failure that is raised
    *beside* the handler changes nothing for the one that has the task. Of that one *by* is the
    module that raised it, or "central", and *body* the failure's data; else the handler raised it,
    and they are "" and empty.
    """

    failure: str
    text: str
    is_beside: bool = False
    by: str = ""
    body: bytes = b""
    copy_of: int = 0


class Attached(NumberedFact, frozen=True, tag="attached"):
    """Exception handler *handler* takes care of a failure ("": any) of a task, or of all tasks of a
    message.
    """

    failure: str
    handler: str
    task: TaskId
    message: str
    maximum: int


class Removed(NumberedFact, frozen=True, tag="removed"):
    """An exception handler or wiretap was taken away."""

    by: str


class Caught(TaskFact, frozen=True, tag="caught"):
    """The failure of a task is handled: task *handler* was made for it, by attachment *attachment*
    of task *at*.
    """

    handler: TaskId
    at: TaskId
    attachment: int
    is_beside: bool = False
    """The failure was raised beside the task's handler: that goes on, or another exception handler
    decides about it.
    """


class Reissued(BaseFact, frozen=True, tag="reissued"):
    """An exception handler could not deal with its failure; the search goes on."""

    handler: TaskId


class Resolved(BaseFact, frozen=True, tag="resolved"):
    """An exception handler says that its failure is resolved: that counts if its task ends without
    a failure.
    """

    handler: TaskId


class NotResolved(BaseFact, frozen=True, tag="not resolved"):
    """An exception handler's task ended and left its failure as it was; the search goes on."""

    handler: TaskId
    task: TaskId


class Unhandled(TaskFact, frozen=True, tag="unhandled"):
    """No exception handler was found for the failure of a task: its top-level task is killed, or
    *undecided*.
    """

    undecided: TaskId = ROOT
    """The exception handler that could not decide because of it: it is killed, and the search for
    the failure that it was called for goes on after it.
    """


class Recovered(TaskFact, frozen=True, tag="recovered"):
    """The failure of a task has been dealt with, by *handler*; the task counts as handled."""

    handler: TaskId = ROOT


class Retried(TaskFact, frozen=True, tag="retried"):
    """A task will be handled again when all under it has ended, with the body as its data if there
    is one.
    """

    body: bytes
    by: str


# --- wiretaps and monitors ------------------------------------------------------------------------


class TapAdded(NumberedFact, frozen=True, tag="tap"):
    """A wiretap: *listener* is sent whenever the condition comes true of a message, or of one task.
    *by* is the module that asked for it first.
    """

    condition: Condition
    listener: str
    message: str
    task: TaskId
    by: str


class TapFired(BaseFact, frozen=True, tag="tapped"):
    """A wiretap sent its listener (message *listener*; 0: nobody handles it, so nothing was
    sent).
    """

    tap: int
    tapped: int
    listener: int


class WaitedFor(MonitorFact, frozen=True, tag="waited for"):
    """A polling or demon monitor was sent to be waited for: else it would end at the latest when
    its parent waits for nothing but such monitors.
    """


class OutlivesRetry(MonitorFact, frozen=True, tag="spared"):
    """Others than the handler of the task above have put a monitor there: a retry of that task
    spares it.
    """


class MonitorTested(MonitorFact, frozen=True, tag="tested"):
    """The condition of a monitor was asked; whether it holds."""

    holds: bool


class MonitorEnded(MonitorFact, frozen=True, tag="monitor ended"):
    """A monitor watches no longer."""

    why: str


Fact = (
    Opened
    | Shortened
    | Closed
    | CentralFailed
    | CentralRestarted
    | WentOn
    | DiskSpace
    | ModuleJoined
    | ModuleLeft
    | ResourceChanged
    | Recalling
    | FormatDefined
    | HandlerAdded
    | HandlerRemoved
    | KeysChanged
    | PermissionsChanged
    | RequestRefused
    | Ignored
    | Received
    | Queued
    | Unqueued
    | Delivered
    | Returned
    | Answered
    | Dropped
    | HandledDirectly
    | LostDirectly
    | Constrained
    | TimedOut
    | Reached
    | Killed
    | KillPlanned
    | SendPlanned
    | DeadlineSet
    | SuspendedOrResumed
    | StateChanged
    | Kept
    | Released
    | Awaited
    | WaitBegan
    | WaitEnded
    | Claimed
    | Granted
    | ClaimEnded
    | Failed
    | Attached
    | Removed
    | Caught
    | Reissued
    | Resolved
    | NotResolved
    | Unhandled
    | Recovered
    | Retried
    | TapAdded
    | TapFired
    | WaitedFor
    | OutlivesRetry
    | MonitorTested
    | MonitorEnded
)


class Entry(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All facts of one cause, and all that followed from it at once. *time* is in seconds since the
    epoch began, on a clock that never jumps; *cause* is None where central itself begins or ends a
    segment.
    """

    number: EntryNumber
    time: EntryTime
    facts: list[Fact]
    cause: Cause | None = None


def kind_of(fact: Fact | type[Fact]) -> str:
    """The word that names a fact's kind: "received"; as people read it, not always as journals have
    it.
    """
    tag = str(fact.__struct_config__.tag)
    return "delay over" if tag == "timed out" else tag  # nothing has failed
