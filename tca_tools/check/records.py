"""Records of the messages, resources and claims of a run at one event. Plain data; the fold fills
them.
"""

from dataclasses import dataclass, field

from tca_tools.properties.world import MessageView
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.points import ALL_MOMENTS
from tca_wire.vocabulary import MessageClass, Role

WaitKey = tuple[str, int, int, str, str]
"""Who waits, and for what: see the facts of waits."""


@dataclass(slots=True, eq=False)
class Hold:
    """A constraint on a moment of a task."""

    constraint: Constraint
    before: "MessageRecord | None"
    """The task that is waited for (None: the root, or it ended before the journal began)."""
    due: float | None  #: when its delay is over, once that is known
    is_over: bool = False  #: its delay is over
    needs: int = field(init=False)
    moment: int = field(init=False)

    def __post_init__(self) -> None:
        self.needs, self.moment = (
            int(self.constraint.before.moment),
            int(self.constraint.after.moment),
        )

    @property
    def is_met(self) -> bool:
        """Whether it holds nothing back any more."""
        if self.constraint.delay:
            return self.is_over
        return self.before is None or bool(self.before.reached & self.needs)


@dataclass(slots=True, eq=False)
class ResourceClaims:
    """The locks and reservations of a resource, held and wanted; of a program with several copies,
    in all of them.
    """

    places: "list[ResourceRecord]" = field(default_factory=list)
    waiting: dict[int, facts.Claimed] = field(default_factory=dict)
    held_by: facts.Claimed | None = None


@dataclass(slots=True, eq=False)
class ResourceRecord:
    """A resource of a module. What it has and what waits for it is listed by delivery."""

    module: str
    name: str
    claims: ResourceClaims
    capacity: int | None = None  #: None: not known
    runs: "dict[int, MessageRecord]" = field(default_factory=dict)
    nested: "dict[int, MessageRecord]" = field(default_factory=dict)
    """Messages that a handler may have taken while it waits for its own module."""
    is_recalling: bool = False  #: nobody is let in before its slot has spoken
    waiting: "dict[int, MessageRecord]" = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class MessageRecord(MessageView):
    """A message: a task of the tree, or a query, an inform, or one copy of a broadcast or
    multi-query.
    """

    id: int
    message: str
    message_class: MessageClass
    sender: str
    sent_by: str
    """The sender; where that is central, the sender of what it made the message for ("": not
    known).
    """
    body: bytes
    role: Role = Role.NONE
    about: int = 0
    original: "MessageRecord | None" = None  #: of a copy
    copies: int = 0  #: how many of its copies are not over
    handling_id: int = field(init=False)  #: its newest delivery
    is_task: bool = field(init=False)
    is_goal: bool = field(init=False)

    parent: "MessageRecord | None" = None
    children: "dict[int, MessageRecord]" = field(default_factory=dict)  #: those that have not ended
    unplanned: int = 0  #: how many goals among them are not planned
    reached: int = 0
    holds: list[Hold] = field(default_factory=list)
    followers: "list[tuple[Hold, MessageRecord]]" = field(default_factory=list)
    """The constraints of others that wait for it."""
    waiters: dict[WaitKey, None] = field(default_factory=dict)  #: the waits for its moments
    is_guest: bool = False  #: a monitor that others have put there
    is_watcher: bool = False  #: a polling or demon monitor that its parent does not wait for
    watchers: int = 0  #: how many of its children are such
    is_orphan: bool = False  #: its parent was sent before the journal begins
    is_stranger: bool = False  #: its constraints are not known, for the same reason

    waits_at: ResourceRecord | None = None
    """The resource whose queue it is in; one without a name: it waits for a handler."""
    place: ResourceRecord | None = None  #: the resource whose handler has it
    begun_in: int = -1  #: the event in which it was begun
    is_new: bool = True
    is_begun: bool = False
    is_killed: bool = False
    never_began: int = 0  #: once it was killed, the starts that it had not reached
    is_suspended: bool = False
    is_over: bool = False
    state: str = ""  #: of its life cycle
    serial: int = 0  #: the number of changes of that
    wanted: bytes = b""  #: the goal that a client wants it to have
    overtaken: tuple[str, ...] = ()
    """The states from which clients have asked for something since its handler's last word."""
    is_retried: bool = False
    is_resolved: bool = False
    is_answered: bool = False
    is_dropped: bool = False
    returned: bool = False  #: its handler is done for good
    again: bool = False  #: it is to be handled once more
    attempts: int = 1
    claims: dict[int, facts.Claimed] = field(default_factory=dict)  #: those that its handler made

    failure: str = ""
    must_fail: bool = False  #: its handler failed, and the failure is still to be raised
    deciding: int = 0  #: the exception handler that decides what becomes of it
    recovering: tuple[int, ...] = ()  #: all exception handlers at work on it
    searches: list[int] = field(default_factory=list)
    """Searches for exception handlers that must come: after which one (OWN and BESIDE: anew)."""
    ended_handlers: "list[MessageRecord]" = field(
        default_factory=list
    )  #: exception handlers that have just ended
    has_resolved: bool = False  #: of an exception handler: it has said so, or asked for a retry
    is_void: bool = False  #: of an exception handler: it decides nothing any more
    invocations: dict[int, int] = field(
        default_factory=dict
    )  #: how often each attachment was called here

    is_tapped: bool = True  #: wiretaps are fired for it
    tap: int = 0  #: of a listener: the wiretap that sent it
    passed: dict[int, int] = field(default_factory=dict)
    """Those since it was sent or last retried, with the listener (0: nobody handles it)."""
    has_fired: bool = False
    asked: int = 0  #: of a monitor: its condition under way
    untested: int = 0  #: of a monitor: answers that it has not looked at

    def __post_init__(self) -> None:
        self.handling_id = self.id
        self.is_task, self.is_goal = self.message_class.is_task, self.message_class.is_goal

    def __str__(self) -> str:
        return f"{self.message} {{{self.id}}}"

    @property
    def parent_id(self) -> int:
        """The task that it is under (0: the root)."""
        return self.parent.id if self.parent else 0

    @property
    def module(self) -> str:  # type: ignore[override]
        """The module whose handler has it now."""
        return self.place.module if self.place else ""

    @property
    def is_queued(self) -> bool:  # type: ignore[override]
        """Whether it waits for a resource, or for a handler."""
        return self.waits_at is not None

    @property
    def is_recovering(self) -> bool:  # type: ignore[override]
        """Whether an exception handler is at work on its failure."""
        return bool(self.recovering)

    @property
    def has_ended(self) -> bool:
        """Whether it is a task that has reached all its moments."""
        return self.reached == ALL_MOMENTS
