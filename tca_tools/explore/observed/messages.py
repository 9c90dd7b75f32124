"""The messages under way in a run: what is known of each, and of all together. fold.py keeps it up to date."""

import msgspec

from tca_tools.properties.world import MessageView
from tca_wire.journal import facts
from tca_wire.points import ROOT, Point
from tca_wire.vocabulary import MessageClass, Role


class ObservedMessage(MessageView, msgspec.Struct, frozen=True, kw_only=True):
    """A message under way, without the names of others."""

    message: str
    message_class: MessageClass
    sender: str
    body: bytes
    reached: int = 0
    is_queued: bool = False
    is_begun: bool = False
    module: str = ""
    role: Role = Role.NONE
    is_killed: bool = False
    failure: str = ""
    is_suspended: bool = False
    attempts: int = 1
    is_over: bool = False
    state: str = ""
    """Of a task: where it is in its life cycle."""
    is_new: bool = False
    is_resolved: bool = False
    is_retried: bool = False
    has_fired: bool = False

    @property
    def is_task(self) -> bool:
        """Whether it is a node of the tree."""
        return self.message_class.is_task


class TakenRequest(msgspec.Struct, frozen=True):
    """A request that central has taken."""

    sender: str
    """The module that asked."""
    call: str
    """The call of the module library by which it did: "kill", "on_termination", ..."""


class TrackedMessage(ObservedMessage, frozen=True, kw_only=True):
    """A message under way, with what names others, and what holds it."""

    id: int
    parent_id: int
    sent_by: str = ""
    """The module that sent it; of what central sent, as what that was sent for ("": it is over)."""
    about: int = 0
    """Where central sent it: the failing, tapped, killed or monitoring task."""
    recovering: tuple[int, ...] = ()
    """The exception handlers' tasks that are at work on its failures."""
    has_resolved: bool = False
    """Of an exception handler: it has said that its failure is resolved, or a retry has resolved that."""
    after: tuple[tuple[int, Point], ...] = ()
    """The constraints on it: which of its moments comes no sooner than which point."""
    delayed: tuple[tuple[int, Point, float], ...] = ()
    """The constraints with a delay in seconds."""
    never_began: int = 0
    """Of a killed task, the starts that it had not reached."""
    not_before: tuple[tuple[int, float], ...] = ()
    """Which of its moments comes no sooner than at which time, in seconds since the run began."""

    def __str__(self) -> str:
        return f"{self.message} {{{int(self.id)}}}"


class Situation:
    """The messages under way. What ended with the last action is still there; what ended before is not."""

    def __init__(self) -> None:
        #: By id, oldest first; each receiver of a broadcast has one of its own.
        self.seen: dict[int, TrackedMessage] = {}
        self.claims: dict[int, facts.Claimed] = {}  #: locks and reservations, waited for or in force
        self.held_by: dict[tuple[str, str], facts.Claimed] = {}  #: those in force, by module and resource
        self.modules: tuple[str, ...] = ()  #: those connected, oldest first
        self.now = 0.0  #: seconds since the run began
        self.passed = 0.0  #: seconds that passed with the last action
        self.taken: TakenRequest | None = None  #: the request that central took with the last action
        self.slots_lost: set[str] = set()  #: the modules that lost one with the last action
        self.broken = ""  #: the promise that central broke with the last action

    @property
    def messages(self) -> list[TrackedMessage]:
        """Everything under way, oldest first."""
        return list(self.seen.values())

    @property
    def tasks(self) -> list[TrackedMessage]:
        """The tasks among them."""
        return [seen for seen in self.seen.values() if seen.is_task]

    def parent(self, task: TrackedMessage) -> TrackedMessage | None:
        """The task that *task* is under; None: the root."""
        return self.seen.get(task.parent_id)

    def children(self, task: TrackedMessage) -> list[TrackedMessage]:
        """The tasks under *task*, oldest first."""
        return [seen for seen in self.seen.values() if seen.is_task and seen.parent_id == task.id]

    def is_past(self, point: Point) -> bool:
        """Whether a point of a task has been reached."""
        leader = self.seen.get(point.task)
        return leader is None or point.task == ROOT or leader.has(point.moment)
