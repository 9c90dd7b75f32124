"""Records of the messages, resources and claims of a run at one event. Plain data."""

from dataclasses import dataclass, field

from tca_tools.properties.world import MessageView
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.points import ALL_MOMENTS
from tca_wire.vocabulary import MessageClass, Role

WaitKey = tuple[str, int, int, str, str]
"""The waiting module and the awaited thing: see the facts of waits."""


@dataclass(slots=True, eq=False)
class Hold:
    """A constraint on a moment of a task."""

    constraint: Constraint
    before: "MessageRecord | None"
    """The awaited task (None: the root, or it ended before the journal began)."""
    due: float | None  #: when its delay ends, once that is known
    is_over: bool = False  #: its delay is over
    needs: int = field(init=False)  #: the moment that *before* must reach
    moment: int = field(init=False)  #: the moment that is held

    def __post_init__(self) -> None:
        self.needs = int(self.constraint.before.moment)
        self.moment = int(self.constraint.after.moment)

    @property
    def is_met(self) -> bool:
        """Whether it no longer blocks the moment."""
        if self.constraint.delay:
            return self.is_over
        return self.before is None or bool(self.before.reached & self.needs)


@dataclass(slots=True, eq=False)
class ResourceClaims:
    """The granted and pending claims on a resource, in all copies of its module."""

    places: "list[ResourceRecord]" = field(default_factory=list)
    waiting: dict[int, facts.Claimed] = field(default_factory=dict)
    held_by: facts.Claimed | None = None


@dataclass(slots=True, eq=False)
class ResourceRecord:
    """A resource of a module, with its running and waiting messages by delivery."""

    module: str
    name: str
    claims: ResourceClaims
    capacity: int | None = None  #: None: not known
    running: "dict[int, MessageRecord]" = field(default_factory=dict)
    nested: "dict[int, MessageRecord]" = field(default_factory=dict)
    """Queries that the module sent itself and tasks, which run while a handler needs them."""
    postponed: "dict[int, MessageRecord]" = field(default_factory=dict)
    """Messages that are replied to later, and whose slots are free."""
    #: Whether a slot must return its prefetched messages. No message enters before it has answered.
    is_recalling: bool = False
    waiting: "dict[int, MessageRecord]" = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class MessageRecord(MessageView):
    """A message: a task, a query, an inform, or one copy of a broadcast or multi-query."""

    id: int
    message: str
    message_class: MessageClass
    sender: str
    sent_by: str
    """The sender; for central's messages, the sender of the message concerned ("": unknown)."""
    body: bytes
    role: Role = Role.NONE
    about: int = 0
    original: "MessageRecord | None" = None  #: the message of a copy
    copies: int = 0  #: the number of its copies under way
    handling_id: int = field(init=False)  #: its newest delivery
    is_within_wait: bool = False  #: whether its slot handles it while another handler waits
    is_task: bool = field(init=False)
    is_goal: bool = field(init=False)

    parent: "MessageRecord | None" = None
    children: "dict[int, MessageRecord]" = field(default_factory=dict)  #: those that have not ended
    unplanned: int = 0  #: the number of children that are goals and not planned
    reached: int = 0
    holds: list[Hold] = field(default_factory=list)
    followers: "list[tuple[Hold, MessageRecord]]" = field(default_factory=list)
    """The constraints of other tasks that wait for it."""
    waiters: dict[WaitKey, None] = field(default_factory=dict)  #: the waits for its moments
    is_foreign_monitor: bool = False  #: a monitor that another module set up
    is_background: bool = False  #: a polling or demon monitor that its parent does not wait for
    background_monitors: int = 0  #: the number of such monitors among its children
    is_orphan: bool = False  #: its parent was sent before the journal started
    is_incomplete: bool = False  #: some of its constraints are unknown

    waits_at: ResourceRecord | None = None
    """The resource in whose queue it is; a resource without a name if it waits for a handler."""
    place: ResourceRecord | None = None  #: the resource whose handler has it
    slot: int = 0  #: the slot of the resource that has, or had, it
    begun_in: int = -1  #: the event in which it started
    is_new: bool = True
    is_begun: bool = False
    is_killed: bool = False
    never_began: int = 0  #: the starts it had not reached when it was killed
    is_suspended: bool = False
    is_over: bool = False
    state: str = ""  #: its state in its life cycle
    serial: int = 0  #: the number of changes of its state
    requested_goal: bytes = b""  #: the newest goal that a client requested
    overtaken: tuple[str, ...] = ()
    """The states in which clients made requests since its handler's last transition."""
    is_retried: bool = False
    is_resolved: bool = False
    is_answered: bool = False
    is_dropped: bool = False
    has_returned: bool = False  #: its handler has returned for the last time
    is_retry_due: bool = False
    chosen_end: str = ""  #: the transition by which its handler has completed it
    is_fallback: bool = False  #: it replaces a task, whose failure it resolves
    fallback: str = ""  #: the message that is to replace its next handling
    attempts: int = 1
    #: The claims that its handler made.
    claims: dict[int, facts.Claimed] = field(default_factory=dict)

    failure: str = ""
    must_fail: bool = False  #: its handler failed, but the failure was not raised yet
    deciding: int = 0  #: the exception handler that decides about its handler's failure
    recovering: tuple[int, ...] = ()  #: all exception handlers at work on its failures
    searches: list[int] = field(default_factory=list)
    """The pending searches for exception handlers. Each is the exception handler that did not
    decide, or OWN or BESIDE for a new failure.
    """
    ended_handlers: "list[MessageRecord]" = field(default_factory=list)
    """The exception handlers that ended with this event."""
    has_resolved: bool = False  #: this exception handler resolved its failure or retried the task
    is_void: bool = False  #: this exception handler no longer decides
    invocations: dict[int, int] = field(default_factory=dict)
    """The number of calls by attachment at this task."""

    is_tapped: bool = True  #: wiretaps are fired for it
    tap: int = 0  #: the wiretap that sent this listener
    taps_passed: dict[int, int] = field(default_factory=dict)
    """By wiretap that this task has passed since its last retry: the listener that was sent (0:
    none, since no module handles it).
    """
    has_fired: bool = False
    open_query: int = 0  #: this monitor's query under way
    untested: int = 0  #: answers that this monitor has not tested

    def __post_init__(self) -> None:
        self.handling_id = self.id
        self.is_task, self.is_goal = self.message_class.is_task, self.message_class.is_goal

    def __str__(self) -> str:
        return f"{self.message} {{{self.id}}}"

    @property
    def parent_id(self) -> int:
        """Its parent (0: the root)."""
        return self.parent.id if self.parent else 0

    @property
    def module(self) -> str:  # type: ignore[override]
        """The module whose handler has it now."""
        return self.place.module if self.place else ""

    @property
    def is_queued(self) -> bool:  # type: ignore[override]
        """Whether it waits for a resource or a handler."""
        return self.waits_at is not None

    @property
    def is_recovering(self) -> bool:  # type: ignore[override]
        """Whether an exception handler is at work on its failure."""
        return bool(self.recovering)

    @property
    def has_ended(self) -> bool:
        """Whether it is a task that has reached all its moments."""
        return self.reached == ALL_MOMENTS
