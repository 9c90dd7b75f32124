"""The messages under way in a run: what is known of each, and of all together. fold.py keeps it up to date."""

from typing import Any

import msgspec

from tca_wire.journal import facts
from tca_wire.points import ROOT, Moment, Point
from tca_wire.vocabulary import MessageClass, Role

_FIRES = (Role.LISTENER, Role.ACTION)


class UnderWay(msgspec.Struct, frozen=True, kw_only=True):
    """What can be said of a message under way without naming others."""

    message: str
    message_class: MessageClass
    sender: str
    body: bytes
    reached: int = 0
    is_queued: bool = False
    """It waits for a resource or for a handler."""
    is_begun: bool = False
    """A handler was given it."""
    module: str = ""
    """The module whose handler has it now."""
    role: Role = Role.NONE
    """Why central sent it; "": a module did."""
    is_killed: bool = False
    failure: str = ""
    """The failure that was raised on it and has not been dealt with."""
    is_suspended: bool = False
    attempts: int = 1
    """How often it has been, or is to be, handled: each retry is one more."""
    is_over: bool = False
    """It ended with the last action, and is out of sight after the next."""
    is_new: bool = False
    """It was sent with the last action."""
    is_retried: bool = False
    """It was retried with the last action."""
    has_fired: bool = False
    """Of a monitor: it sent its action with the last action."""

    @property
    def data(self) -> Any:
        """What was sent with it, as plain values; None of what is sent without, such as for a module that was lost."""
        return msgspec.msgpack.decode(self.body) if self.body else None

    @property
    def is_task(self) -> bool:
        """Whether it is a goal or a command."""
        return self.message_class.is_task

    def has(self, moment: Moment) -> bool:
        """Whether it has reached *moment*. A killed task has reached all when it ends."""
        return bool(self.reached & moment)

    @property
    def is_handled(self) -> bool:
        """Whether a handler has it now."""
        return bool(self.module)

    @property
    def is_fire(self) -> bool:
        """Whether a wiretap or a monitor has just sent it."""
        return self.is_new and self.role in _FIRES

    @property
    def is_planned(self) -> bool:
        """Whether it and everything under it has been expanded; of a command always."""
        return self.has(Moment.END_PLANNING)

    @property
    def is_being_achieved(self) -> bool:
        """Whether its achieving has started and not ended."""
        return self.has(Moment.START_ACHIEVING) and not self.has(Moment.END_ACHIEVING)

    @property
    def is_planned_ahead(self) -> bool:
        """Whether it was begun before it may be achieved."""
        return self.is_begun and not self.has(Moment.START_ACHIEVING)

    @property
    def is_achieved(self) -> bool:
        """Whether it was achieved, not killed, with the last action."""
        return self.has(Moment.END_ACHIEVING) and not self.is_killed


class Taken(msgspec.Struct, frozen=True):
    """A request that central has taken."""

    sender: str
    """The module that asked."""
    call: str
    """The call of the module library by which it did: "kill", "on_termination", ..."""


class Tracked(UnderWay, frozen=True, kw_only=True):
    """A message under way, with what names others, and what holds it."""

    id: int
    parent_id: int
    sent_by: str = ""
    """The module that sent it; of what central sent, as what that was sent for ("": it is over)."""
    about: int = 0
    """Where central sent it: the failing, tapped, killed or monitoring task."""
    recovering: tuple[int, ...] = ()
    """The exception handlers' tasks that are at work on its failures."""
    after: tuple[tuple[int, Point], ...] = ()
    """The constraints on it: which of its moments comes no sooner than which point."""
    delayed: tuple[tuple[int, Point, float], ...] = ()
    """The same, and so many seconds later."""
    not_before: tuple[tuple[int, float], ...] = ()
    """Which of its moments comes no sooner than at which time, in seconds since the run began."""

    def __str__(self) -> str:
        return f"{self.message} {{{self.id}}}"


class Situation:
    """The messages under way. What ended with the last action is still there; what ended before is not."""

    def __init__(self) -> None:
        self.seen: dict[int, Tracked] = {}  #: by id, oldest first; each receiver of a broadcast has one of its own
        self.claims: dict[int, facts.Claimed] = {}  #: locks and reservations, waited for or in force
        self.held_by: dict[tuple[str, str], facts.Claimed] = {}  #: those in force, by module and resource
        self.modules: tuple[str, ...] = ()  #: those connected, oldest first
        self.now = 0.0  #: seconds since the run began
        self.passed = 0.0  #: seconds that passed with the last action
        self.taken: Taken | None = None  #: what a script asked for with the last action, if central took it
        self.broken = ""  #: what central did against its promises with the last action

    @property
    def messages(self) -> list[Tracked]:
        """Everything under way, oldest first."""
        return list(self.seen.values())

    @property
    def tasks(self) -> list[Tracked]:
        """The tasks among them."""
        return [seen for seen in self.seen.values() if seen.is_task]

    def parent(self, task: Tracked) -> Tracked | None:
        """The task that *task* is under; None: the root."""
        return self.seen.get(task.parent_id)

    def children(self, task: Tracked) -> list[Tracked]:
        """The tasks under *task*, oldest first."""
        return [seen for seen in self.seen.values() if seen.is_task and seen.parent_id == task.id]

    def is_past(self, point: Point) -> bool:
        """Whether a point of a task has been reached."""
        leader = self.seen.get(point.task)
        return leader is None or point.task == ROOT or leader.has(point.moment)
