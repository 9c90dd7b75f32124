"""What can be seen of a run at one moment: every message under way, folded from the facts that central records.

Knows nothing of how central does it. promises.py holds central to its promises with nothing but this.
"""

from collections.abc import Callable, Iterable
from typing import Any

import msgspec
from msgspec.structs import replace

from tca_explorer import promises
from tca_wire import facts
from tca_wire.constraints import Constraint
from tca_wire.points import ALL_MOMENTS, ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Role

_FIRES = (Role.LISTENER, Role.ACTION)

_HELD = {
    Condition.BEFORE_HANDLING: (Moment.START_HANDLING, Moment.END_HANDLING),
    Condition.BEFORE_PLANNING: (Moment.START_PLANNING, Moment.END_PLANNING),
    Condition.BEFORE_ACHIEVING: (Moment.START_ACHIEVING, Moment.END_ACHIEVING),
}
"""By condition: which moment of the tapped task comes no sooner than which of the listener."""


class Seen(msgspec.Struct, frozen=True):
    """A message under way: a task of the tree, or a query, an inform, or one copy of a broadcast or multi-query."""

    id: int
    message: str
    message_class: MessageClass
    sender: str
    parent_id: int
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
    about: int = 0
    """Where central sent it: the failing, tapped, killed or monitoring task."""
    is_killed: bool = False
    failure: str = ""
    """The failure that was raised on it and has not been dealt with."""
    recovering: tuple[int, ...] = ()
    """The exception handlers' tasks that are at work on its failures."""
    is_suspended: bool = False
    attempts: int = 1
    """How often it has been, or is to be, handled: each retry is one more."""
    after: tuple[tuple[int, Point], ...] = ()
    """The constraints on it: which of its moments comes no sooner than which point."""
    delayed: tuple[tuple[int, Point, float], ...] = ()
    """The same, and so many seconds later."""
    not_before: tuple[tuple[int, float], ...] = ()
    """Which of its moments comes no sooner than at which time, in seconds since the run began."""
    is_over: bool = False
    """It ended with the last action, and is out of sight after the next."""
    is_new: bool = False
    """It was sent with the last action."""
    is_retried: bool = False
    """It was retried with the last action."""
    has_fired: bool = False
    """Of a monitor: it sent its action with the last action."""

    def __str__(self) -> str:
        return f"{self.message} {{{self.id}}}"

    @property
    def data(self) -> Any:
        """What was sent with it, as plain values."""
        return msgspec.msgpack.decode(self.body)

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
    def is_recovering(self) -> bool:
        """Whether an exception handler is at work on its failure."""
        return bool(self.recovering)

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


class World:
    """The messages under way. What ended with the last action is still there; what ended before is not."""

    def __init__(self) -> None:
        self.seen: dict[int, Seen] = {}  #: by id, oldest first; each receiver of a broadcast has one of its own
        self.claims: dict[int, facts.Claimed] = {}  #: locks and reservations, waited for or in force
        self.held_by: dict[tuple[str, str], facts.Claimed] = {}  #: those in force, by module and resource
        self.modules: tuple[str, ...] = ()  #: those connected, oldest first
        self.now = 0.0  #: seconds since the run began
        self.broken = ""  #: what central did against its promises with the last action
        self.unfinished: tuple[str, ...] = ()  #: who still waits or runs when nothing further can happen, in words
        self._tasks: dict[int, int] = {}  #: of deliveries of tasks that are retried
        self._conditions: dict[int, Condition] = {}  #: of wiretaps

    @property
    def messages(self) -> list[Seen]:
        """Everything under way, oldest first."""
        return list(self.seen.values())

    @property
    def tasks(self) -> list[Seen]:
        """The tasks among them."""
        return [seen for seen in self.seen.values() if seen.is_task]

    def parent(self, task: Seen) -> Seen | None:
        """The task that *task* is under; None: the root."""
        return self.seen.get(task.parent_id)

    def children(self, task: Seen) -> list[Seen]:
        """The tasks under *task*, oldest first."""
        return [seen for seen in self.seen.values() if seen.is_task and seen.parent_id == task.id]

    def is_past(self, point: Point) -> bool:
        """Whether a point of a task has been reached."""
        leader = self.seen.get(point.task)
        return leader is None or point.task == ROOT or leader.has(point.moment)

    # --- the fold ----------------------------------------------------------------------------------------------------

    def forget_what_is_over(self) -> None:
        """A new action begins."""
        for key, seen in list(self.seen.items()):
            if seen.is_over:
                del self.seen[key]
            elif seen.is_new or seen.is_retried or seen.has_fired:
                self._change(key, is_new=False, is_retried=False, has_fired=False)
        self._tasks = {given: task for given, task in self._tasks.items() if task in self.seen}
        self.broken = ""

    def take(self, recorded: Iterable[facts.Fact]) -> None:
        """Take in what central recorded, now."""
        for fact in recorded:
            if do := _FOLD.get(type(fact)):
                do(self, fact)

    def _change(self, key: int, **changes: Any) -> None:
        if (seen := self.seen.get(key)) is not None:
            self.seen[key] = replace(seen, **changes)

    def _received(self, fact: facts.Received) -> None:
        is_original = fact.message_class in (MessageClass.BROADCAST, MessageClass.MULTI_QUERY)
        parent = self.seen.get(fact.parent)
        is_safe = fact.role in (Role.TERMINATION, Role.CANCEL)
        self.seen[fact.id] = Seen(
            fact.id, fact.message, fact.message_class, fact.sender, fact.parent, fact.body, is_over=is_original,
            role=fact.role, about=fact.about, is_new=True,
            is_suspended=parent is not None and parent.is_suspended and not is_safe,
        )  # fmt: skip
        if fact.role is Role.EXCEPTION and (failing := self.seen.get(fact.about)) is not None:
            self._change(fact.about, recovering=(*failing.recovering, fact.id))
        elif fact.role is Role.ACTION:
            self._change(fact.about, has_fired=True)
        self._constrain(fact.constraints)

    def _constrained(self, fact: facts.Constrained) -> None:
        self._constrain(fact.constraints)

    def _constrain(self, constraints: Iterable[Constraint]) -> None:
        for before, after, delay in ((one.before, one.after, one.delay) for one in constraints):
            moment, task = int(after.moment), self.seen[after.task]
            if before.task == ROOT:
                self._change(task.id, not_before=(*task.not_before, (moment, delay)))
            elif delay:
                self._change(task.id, delayed=(*task.delayed, (moment, before, delay)))
            else:
                self._change(task.id, after=(*task.after, (moment, before)))

    def _key(self, fact: facts.Queued | facts.Delivered) -> int:
        """By which a message is known here; a retried task has another delivery each time."""
        original = self.seen[fact.message_id]
        if original.is_task:
            if fact.id != fact.message_id:
                self._tasks[fact.id] = fact.message_id
            return fact.message_id
        if fact.id not in self.seen:
            self.seen[fact.id] = replace(original, id=fact.id, is_over=False)
        return fact.id

    def _claimed(self, fact: facts.Claimed) -> None:
        self.claims[fact.id] = fact

    def _granted(self, fact: facts.Granted) -> None:
        claim = self.claims[fact.id]
        self.held_by[claim.module, claim.resource] = claim

    def _claim_ended(self, fact: facts.ClaimEnded) -> None:
        claim = self.claims.pop(fact.id)
        if self.held_by.get((claim.module, claim.resource)) is claim:
            del self.held_by[claim.module, claim.resource]

    def _queued(self, fact: facts.Queued) -> None:
        self._change(self._key(fact), is_queued=True, module="")

    def _unqueued(self, fact: facts.Unqueued) -> None:
        self._change(self._tasks.get(fact.id, fact.id), is_queued=False)

    def _delivered(self, fact: facts.Delivered) -> None:
        key = self._key(fact)
        self.broken = self.broken or promises.delivered(self, self.seen[key], fact)
        self._change(key, is_queued=False, is_begun=True, module=fact.module)

    def _returned(self, fact: facts.Returned) -> None:
        key = self._tasks.get(fact.id, fact.id)
        seen = self.seen.get(key)
        self.broken = self.broken or promises.returned(seen, key)
        if seen is not None:
            self._change(key, module="", is_over=not seen.is_task)

    def _failed(self, fact: facts.Failed) -> None:
        if fact.is_beside:
            self._change(fact.id, failure=fact.failure)
        elif fact.id in self.seen:
            self._change(fact.id, module="", failure=fact.failure, is_over=not self.seen[fact.id].is_task)

    def _unhandled(self, fact: facts.Unhandled) -> None:
        """The top-level task has failed, too."""
        failing = top = self.seen[fact.task]
        while (parent := self.parent(top)) is not None:
            top = parent
        self._change(top.id, failure=top.failure or failing.failure)

    def _reissued(self, fact: facts.Reissued) -> None:
        self._recover(self.seen[fact.handler])

    def _recover(self, handler: Seen) -> None:
        """An exception handler is at work no longer."""
        if (failing := self.seen.get(handler.about)) is not None:
            self._change(failing.id, recovering=tuple(one for one in failing.recovering if one != handler.id))

    def _dealt_with(self, fact: facts.Recovered) -> None:
        self._change(fact.task, failure="")

    def _retried(self, fact: facts.Retried) -> None:
        task = self.seen[fact.task]
        self._change(fact.task, failure="", attempts=task.attempts + task.is_begun, is_retried=True,
                     body=fact.body or task.body)  # fmt: skip

    def _suspended(self, fact: facts.SuspendedOrResumed) -> None:
        below = {int(fact.task)}
        for task in self.tasks:  # parents are older than their children
            if task.id in below or task.parent_id in below:
                below.add(task.id)
                self._change(task.id, is_suspended=fact.is_suspended)

    def _killed(self, fact: facts.Killed) -> None:
        self._change(fact.task, is_killed=True, is_suspended=False)

    def _dropped(self, fact: facts.Dropped) -> None:
        if fact.id in self.seen:
            self._change(fact.id, is_queued=False, is_over=not self.seen[fact.id].is_handled)

    def _tap_added(self, fact: facts.TapAdded) -> None:
        self._conditions[fact.id] = fact.condition

    def _tap_fired(self, fact: facts.TapFired) -> None:
        listener, tapped = self.seen.get(fact.listener), self.seen.get(fact.tapped)
        if listener is None or tapped is None or not (listener.is_task and tapped.is_task):
            return
        if held := _HELD.get(self._conditions[fact.tap]):
            moment, end = held
            self._change(tapped.id, after=(*tapped.after, (int(moment), Point(TaskId(listener.id), end))))

    def _joined(self, fact: facts.ModuleJoined) -> None:
        self.modules = (*self.modules, fact.module)

    def _left(self, fact: facts.ModuleLeft) -> None:
        self.modules = tuple(name for name in self.modules if name != fact.module)

    def _reached(self, fact: facts.Reached) -> None:
        task = self.seen[fact.task]
        reached = task.reached | fact.moments
        self._change(task.id, reached=reached, is_over=reached == ALL_MOMENTS)
        self.broken = self.broken or promises.reached(self, self.seen[task.id], fact.moments)
        if reached == ALL_MOMENTS and task.role is Role.EXCEPTION:
            self._recover(task)
        for follower in self.tasks:
            if follower.delayed:
                self._begin_delays(follower, fact)

    def _begin_delays(self, follower: Seen, fact: facts.Reached) -> None:
        """What comes so many seconds after what was just reached."""
        begun = [one for one in follower.delayed if one[1].task == fact.task and one[1].moment & fact.moments]
        times = [(moment, self.now + delay) for moment, _, delay in begun]
        self._change(follower.id, not_before=(*follower.not_before, *times),
                     delayed=tuple(one for one in follower.delayed if one not in begun))  # fmt: skip


# ruff: noqa: SLF001
_FOLD: dict[type, Callable[[World, Any], None]] = {
    facts.Received: World._received,
    facts.Claimed: World._claimed,
    facts.Granted: World._granted,
    facts.ClaimEnded: World._claim_ended,
    facts.Constrained: World._constrained,
    facts.Queued: World._queued,
    facts.Unqueued: World._unqueued,
    facts.Delivered: World._delivered,
    facts.Returned: World._returned,
    facts.Failed: World._failed,
    facts.Unhandled: World._unhandled,
    facts.Reissued: World._reissued,
    facts.Recovered: World._dealt_with,
    facts.Retried: World._retried,
    facts.SuspendedOrResumed: World._suspended,
    facts.Killed: World._killed,
    facts.Dropped: World._dropped,
    facts.TapAdded: World._tap_added,
    facts.TapFired: World._tap_fired,
    facts.Reached: World._reached,
    facts.ModuleJoined: World._joined,
    facts.ModuleLeft: World._left,
}
