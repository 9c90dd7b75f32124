"""What is known of the messages, resources and claims of a run at one event. Plain records; the fold fills them."""

from tca_properties.world import MessageView
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.points import ALL_MOMENTS


class Hold:
    """A constraint on a moment of a task."""

    __slots__ = ("before", "constraint", "due", "is_over", "moment", "needs")

    def __init__(self, constraint: Constraint, before: "MessageRecord | None", due: float | None) -> None:
        self.constraint = constraint
        self.before = before  #: the task that is waited for (None: the root, or it ended before the journal began)
        self.needs = int(constraint.before.moment)
        self.moment = int(constraint.after.moment)
        self.due = due  #: when its delay is over, once that is known
        self.is_over = False  #: its delay is over

    @property
    def is_met(self) -> bool:
        """Whether it holds nothing back any more."""
        if self.constraint.delay:
            return self.is_over
        return self.before is None or bool(self.before.reached & self.needs)


class ResourceClaims:
    """Who has a resource for himself, or wants it: of a program that runs in several copies, in all of them."""

    __slots__ = ("held_by", "places", "waiting")

    def __init__(self) -> None:
        self.places: list[ResourceRecord] = []
        self.waiting: dict[int, facts.Claimed] = {}  #: locks and reservations that are waited for
        self.held_by: facts.Claimed | None = None


class ResourceRecord:
    """A resource of a module."""

    __slots__ = ("capacity", "claims", "module", "name", "nested", "runs", "waiting")

    def __init__(self, module: str, name: str, claims: ResourceClaims) -> None:
        self.module, self.name, self.claims = module, name, claims
        claims.places.append(self)
        self.capacity: int | None = None  #: None: not known
        self.runs: dict[int, MessageRecord] = {}  #: what its handlers have, by delivery
        #: What a handler that waits for its own module may have taken in between.
        self.nested: dict[int, MessageRecord] = {}
        self.waiting: dict[int, MessageRecord] = {}  #: by delivery


class MessageRecord(MessageView):
    """A message: a task of the tree, or a query, an inform, or one copy of a broadcast or multi-query."""

    __slots__ = (
        "about",
        "again",
        "asked",
        "attempts",
        "begun_in",
        "body",
        "children",
        "claims",
        "copies",
        "deciding",
        "ended_handlers",
        "failure",
        "fired",
        "followers",
        "given_as",
        "has_fired",
        "holds",
        "id",
        "invocations",
        "is_answered",
        "is_begun",
        "is_dropped",
        "is_goal",
        "is_guest",
        "is_killed",
        "is_new",
        "is_orphan",
        "is_over",
        "is_retried",
        "is_stranger",
        "is_suspended",
        "is_tapped",
        "is_task",
        "is_void",
        "message",
        "message_class",
        "must_fail",
        "origin",
        "original",
        "parent",
        "passed",
        "place",
        "reached",
        "recovering",
        "returned",
        "role",
        "searches",
        "sender",
        "sent_by",
        "unplanned",
        "untested",
        "waiters",
        "waits_at",
    )  # fmt: skip

    def __init__(self, fact: facts.Received, parent: "MessageRecord | None") -> None:
        self.id = self.given_as = fact.id
        self.message, self.message_class = fact.message, fact.message_class
        self.sender = self.sent_by = fact.sender  #: *sent_by*, where central did: as what it made it for ("": unknown)
        self.parent, self.body, self.role, self.about, self.origin = (
            parent, fact.body, fact.role, fact.about, fact.origin
        )  # fmt: skip
        self.is_task, self.is_goal = fact.message_class.is_task, fact.message_class.is_goal
        #: A monitor that others have put there; what it hangs under was sent before the journal begins.
        self.is_guest = self.is_orphan = False
        self.is_stranger = False  #: what holds it is not known, for the same reason
        self.original: MessageRecord | None = None  #: of a copy
        self.copies = 0  #: number of those that are not over
        self.reached = 0
        self.children: dict[int, MessageRecord] = {}  #: those that have not ended
        self.unplanned = 0  #: number of goals among them that are not planned
        self.holds: list[Hold] = []
        self.followers: list[tuple[Hold, MessageRecord]] = []  #: the constraints of others that wait for it
        #: The resource whose queue it is in; one without a name: for a handler.
        self.waits_at: ResourceRecord | None = None
        self.place: ResourceRecord | None = None  #: the resource whose handler has it
        self.begun_in = -1  #: the event in which it was begun
        self.asked = self.untested = 0  #: of a monitor: its condition under way; answers that it has not looked at
        self.is_begun = self.is_killed = self.is_suspended = self.is_over = False
        self.is_new, self.is_retried, self.has_fired = True, False, False
        self.is_answered = self.is_dropped = False
        self.returned = self.again = False  #: its handler is done for good; it is to be handled once more
        self.must_fail = False  #: its handler failed, and the failure is still to be raised
        self.attempts, self.failure = 1, ""
        self.deciding = 0  #: the exception handler that decides what becomes of it
        self.recovering: tuple[int, ...] = ()
        self.searches: list[int] = []  #: searches for exception handlers that must come: after which one (0: anew)
        self.ended_handlers: list[int] = []  #: exception handlers that have just ended
        self.is_void = False  #: of an exception handler: it decides nothing any more
        self.invocations: dict[int, int] = {}  #: how often each attachment was called here
        self.is_tapped = True  #: wiretaps are fired for it
        self.fired: set[int] = set()  #: the wiretaps that were fired for it
        #: Those since it was sent or last retried -> the listener (0: nobody handles it).
        self.passed: dict[int, int] = {}
        self.claims: dict[int, facts.Claimed] = {}  #: what was claimed for it
        self.waiters: list[tuple[str, int, int]] = []  #: who waits for which moment of it

    def __str__(self) -> str:
        return f"{self.message} {{{self.id}}}"

    # --- what properties see ---------------------------------------------------------------------------------------

    @property
    def parent_id(self) -> int:
        """The task that it is under (0: the root)."""
        return self.parent.id if self.parent else 0

    @property
    def module(self) -> str:
        """The module whose handler has it now."""
        return self.place.module if self.place else ""

    @property
    def is_queued(self) -> bool:
        """Whether it waits for a resource, or for a handler."""
        return self.waits_at is not None

    @property
    def is_recovering(self) -> bool:
        """Whether an exception handler is at work on its failure."""
        return bool(self.recovering)

    @property
    def has_ended(self) -> bool:
        """Whether it is a task that has reached all its moments."""
        return self.reached == ALL_MOMENTS
