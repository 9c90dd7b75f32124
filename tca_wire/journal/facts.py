"""What the journal records: one type a fact; the field order is the order on disk.

A fact says what happened, never what follows from it: tools fold facts and re-run no rule. Every message accepted by
central has an *id* from one counter; a goal's or command's id is its task. A *delivery* is one message on its way to
one handler; its id is the message's own, except that each receiver of a broadcast or multi-query has one of its own.
What failures, wiretaps and monitors leave in the journal is in facts_of_watching.py.
"""

from typing import Annotated

import msgspec

from tca_wire.constraints import Constraint
from tca_wire.journal.facts_of_watching import (
    Attached,
    Caught,
    Failed,
    MonitorEnded,
    MonitorTested,
    Recovered,
    Reissued,
    Removed,
    Retried,
    TapAdded,
    TapFired,
    Unhandled,
    _Fact,
)  # fmt: skip
from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Refusal, Role, Scope

JOURNAL_VERSION = 1
LONGEST_TIME = 1e12  # seconds, 30 000 years: no entry is later
EntryTime = Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_TIME)]

__all__ = [
    "JOURNAL_VERSION", "Answered", "Attached", "Awaited", "Caught", "ClaimEnded", "Claimed", "Closed",
    "Constrained", "DeadlineSet", "Delivered", "Dropped", "Entry", "EntryTime", "Fact", "Failed", "FormatDefined",
    "Granted", "HandledDirectly", "HandlerAdded", "HandlerRemoved", "Ignored", "Kept", "KillPlanned", "Killed",
    "LostDirectly", "ModuleJoined", "ModuleLeft", "MonitorEnded", "MonitorTested", "Opened", "Queued", "Reached",
    "Received", "Recovered", "Reissued", "Released", "Removed", "RequestRefused", "ResourceChanged", "Retried",
    "Returned", "SuspendedOrResumed", "TapAdded", "TapFired", "TimedOut", "Unhandled", "Unqueued", "WaitBegan",
    "WaitEnded", "kind_of",
]  # fmt: skip


class Opened(_Fact, frozen=True, tag="opened"):
    """A segment begins. *began* is wall-clock time (seconds since 1970) at which the entries' clock showed 0."""

    version: int
    epoch: str
    segment: int
    began: float
    central: str


class Closed(_Fact, frozen=True, tag="closed"):
    """Central ended of its own will."""

    why: str


class ModuleJoined(_Fact, frozen=True, tag="module joined"):
    """A module said hello; *module* is its name, made unique among those connected."""

    module: str
    process: str


class ModuleLeft(_Fact, frozen=True, tag="module left"):
    """A module closed its connection or was lost."""

    module: str
    why: str


class ResourceChanged(_Fact, frozen=True, tag="resource"):
    """A resource of a module now takes *capacity* messages at a time."""

    module: str
    resource: str
    capacity: int


class FormatDefined(_Fact, frozen=True, tag="format"):
    """The first declaration of a message (formats as JSON Schema)."""

    message: str
    message_class: MessageClass
    data: str
    reply: str
    module: str


class HandlerAdded(_Fact, frozen=True, tag="handler"):
    """A module now handles a message, in this resource."""

    message: str
    module: str
    resource: str


class HandlerRemoved(_Fact, frozen=True, tag="no handler"):
    """A module no longer handles a message."""

    message: str
    module: str


class Received(_Fact, frozen=True, tag="received"):
    """Central accepted a message; for a goal or command this is the birth of a task under *parent*.

    *origin* is the delivery that the sender was handling when it sent (0: none); *blocking* says that the sender does
    nothing until the answer comes, or until it gives up.
    """

    id: int
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
    """Where central made it: the failing, tapped, killed or monitoring task."""


class Constrained(_Fact, frozen=True, tag="constrained"):
    """Constraints were added between tasks that existed."""

    constraints: list[Constraint]


class Queued(_Fact, frozen=True, tag="queued"):
    """A delivery of message *message_id* waits: for a resource that is busy, or for a handler (module, resource "")."""

    id: int
    message_id: int
    module: str
    resource: str


class Unqueued(_Fact, frozen=True, tag="unqueued"):
    """A delivery waits no longer and nobody was given it: its task is held again, suspended or killed, its sender
    gave up, or the handler that had it left.
    """

    id: int


class Delivered(_Fact, frozen=True, tag="delivered"):
    """A delivery of message *message_id* was sent to a handler."""

    id: int
    message_id: int
    module: str
    resource: str


class Returned(_Fact, frozen=True, tag="returned"):
    """The handler of a delivery ended; the body is its reply or result, or the data of its failure."""

    id: int
    outcome: Outcome
    body: bytes


class Reached(_Fact, frozen=True, tag="reached"):
    """A task reached moments (a bit mask, see points.Moment)."""

    task: TaskId
    moments: int


class Killed(_Fact, frozen=True, tag="killed"):
    """A task was killed. It ends when its handler, if one runs, has returned. *by* is, here and below, the module that
    asked for it, or "central" ("": an older journal does not tell).
    """

    task: TaskId
    why: str
    by: str = ""


class SuspendedOrResumed(_Fact, frozen=True, tag="suspended"):
    """A task was suspended or resumed, with all that is under it."""

    task: TaskId
    is_suspended: bool
    by: str = ""


class DeadlineSet(_Fact, frozen=True, tag="deadline"):
    """If a task does not reach a moment within so many seconds from now, the failure "timeout" is raised on it."""

    task: TaskId
    moment: int
    seconds: float


class KillPlanned(_Fact, frozen=True, tag="to be killed"):
    """A task is to be killed, or what *scope* says, when *after* is reached (None: now) and so many seconds more."""

    task: TaskId
    scope: Scope
    after: Point | None
    seconds: float
    why: str
    by: str


class Kept(_Fact, frozen=True, tag="kept"):
    """A module keeps a task: its data, outcome and place are remembered after its end."""

    task: TaskId
    module: str


class Released(_Fact, frozen=True, tag="released"):
    """A module keeps a task no longer; or ("") its record is gone, for all."""

    task: TaskId
    module: str


class TimedOut(_Fact, frozen=True, tag="timed out"):
    """A delay is over: what this constraint held back is held by it no longer."""

    constraint: Constraint


class Dropped(_Fact, frozen=True, tag="dropped"):
    """A message or delivery came to nothing."""

    id: int
    why: str


class Answered(_Fact, frozen=True, tag="answered"):
    """The sender of a message got its (last) answer."""

    id: int


class Awaited(_Fact, frozen=True, tag="awaited"):
    """Whoever sent a query or multi-query, and went on, waits for its answer from now on."""

    id: int


class HandledDirectly(_Fact, frozen=True, tag="direct"):
    """A module handled a message that came from its sender directly; central has seen nothing of it but this note.

    *origin* is the delivery whose handler sent it (0: none), *size* the bytes of its data; its handler ended at *ended*
    on the clock of the entries and took so many *seconds*.
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


class LostDirectly(_Fact, frozen=True, tag="direct lost"):
    """As *module* says, so many informs of *message* ("": notes of direct messages) were sent directly and lost."""

    module: str
    message: str
    number: int


class WaitBegan(_Fact, frozen=True, tag="wait began"):
    """The handler of delivery *origin* (0: code outside a handler) of a module blocks until a task reaches a moment."""

    module: str
    origin: int
    task: TaskId
    moment: int


class WaitEnded(_Fact, frozen=True, tag="wait ended"):
    """Such a wait ended."""

    module: str
    origin: int
    task: TaskId


class Claimed(_Fact, frozen=True, tag="claimed"):
    """A module waits to lock a resource, or (*is_reserved*) to reserve it, in delivery *origin* (0: in none)."""

    id: int
    module: str
    resource: str
    is_reserved: bool
    sender: str
    origin: int


class Granted(_Fact, frozen=True, tag="granted"):
    """A resource is locked, or reserved, from now on."""

    id: int


class ClaimEnded(_Fact, frozen=True, tag="claim ended"):
    """A resource is not locked or reserved any more, or is no longer waited for to be."""

    id: int
    why: str


class RequestRefused(_Fact, frozen=True, tag="refused"):
    """A request of a connection (a module's name or, before it said hello, "?") was refused."""

    sender: str
    refusal: Refusal
    text: str


class Ignored(_Fact, frozen=True, tag="ignored"):
    """A request of a module changed nothing: what it asked for was no longer possible, and it could not know that."""

    sender: str
    text: str


Fact = (
    Opened | Closed | ModuleJoined | ModuleLeft | ResourceChanged | FormatDefined | HandlerAdded | HandlerRemoved
    | Received | Constrained | Queued | Unqueued | Delivered | Returned | Reached | Failed | Killed | Dropped | Answered
    | Awaited | WaitBegan | WaitEnded | RequestRefused | Ignored | HandledDirectly | LostDirectly
    | TapAdded | TapFired | MonitorTested | MonitorEnded
    | Claimed | Granted | ClaimEnded
    | Attached | Removed | Caught | Reissued | Unhandled | Recovered | Retried | SuspendedOrResumed | TimedOut
    | Kept | Released | DeadlineSet | KillPlanned
)  # fmt: skip


class Entry(msgspec.Struct, frozen=True, array_like=True):
    """All facts that one event caused. *time* is in seconds since the epoch began, on a clock that never jumps."""

    number: int
    time: EntryTime
    facts: list[Fact]


def kind_of(fact: Fact | type[Fact]) -> str:
    """The word that names a fact's kind: "received"; as people read it, not always as journals have it."""
    tag = str(fact.__struct_config__.tag)
    return _SAID.get(tag, tag)


_SAID = {"timed out": "delay over"}  # nothing has failed
