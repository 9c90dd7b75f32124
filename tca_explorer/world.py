"""What can be seen of a run at one moment: every message under way, folded from the facts that central records.

Also holds central to its promises with nothing but these facts: no point before those that constraints put before it,
no child's start before its parent's, no parent's end before its children's. Knows nothing of how central does it.
"""

from collections.abc import Callable, Iterable
from typing import Any

import msgspec
from msgspec.structs import replace

from tca_wire import facts
from tca_wire.constraints import Constraint
from tca_wire.points import ALL_MOMENTS, ROOT, Moment, Point
from tca_wire.vocabulary import MessageClass

_STARTS = int(Moment.START_PLANNING | Moment.START_ACHIEVING)
_ENDS = (int(Moment.END_PLANNING), int(Moment.END_ACHIEVING))


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
    is_killed: bool = False
    failure: str = ""
    after: tuple[tuple[int, Point], ...] = ()
    """The constraints on it: which of its moments comes no sooner than which point."""
    is_over: bool = False
    """It ended with the last action, and is out of sight after the next."""

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
    def is_planned(self) -> bool:
        """Whether it and everything under it has been expanded; of a command always."""
        return self.has(Moment.END_PLANNING)

    @property
    def is_being_achieved(self) -> bool:
        """Whether its achieving has started and not ended."""
        return self.has(Moment.START_ACHIEVING) and not self.has(Moment.END_ACHIEVING)

    @property
    def is_achieved(self) -> bool:
        """Whether it was achieved, not killed, with the last action."""
        return self.has(Moment.END_ACHIEVING) and not self.is_killed


class World:
    """The messages under way. What ended with the last action is still there; what ended before is not."""

    def __init__(self) -> None:
        self.seen: dict[int, Seen] = {}  #: by delivery, oldest first
        self.modules: tuple[str, ...] = ()  #: those connected, oldest first
        self.broken = ""  #: what central did against its promises with the last action
        self.unfinished: tuple[str, ...] = ()  #: who still waits or runs when nothing further can happen, in words

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

    # --- the fold ----------------------------------------------------------------------------------------------------

    def fork(self) -> "World":
        """A world that goes on from here by itself."""
        world = World()
        world.seen, world.modules = dict(self.seen), self.modules
        return world

    def forget_what_is_over(self) -> None:
        """A new action begins."""
        self.seen = {key: seen for key, seen in self.seen.items() if not seen.is_over}
        self.broken = ""

    def take(self, recorded: Iterable[facts.Fact]) -> None:
        """Take in what central recorded."""
        for fact in recorded:
            if do := _FOLD.get(type(fact)):
                do(self, fact)

    def _change(self, key: int, **changes: Any) -> None:
        if (seen := self.seen.get(key)) is not None:
            self.seen[key] = replace(seen, **changes)

    def _received(self, fact: facts.Received) -> None:
        is_original = fact.message_class in (MessageClass.BROADCAST, MessageClass.MULTI_QUERY)
        self.seen[fact.id] = Seen(
            fact.id, fact.message, fact.message_class, fact.sender, fact.parent, fact.body, is_over=is_original
        )
        self._constrain(fact.constraints)

    def _constrained(self, fact: facts.Constrained) -> None:
        self._constrain(fact.constraints)

    def _constrain(self, constraints: Iterable[Constraint]) -> None:
        for constraint in constraints:
            task = constraint.after.task
            self._change(task, after=(*self.seen[task].after, (int(constraint.after.moment), constraint.before)))

    def _queued(self, fact: facts.Queued) -> None:
        self._make_copy(fact.id, fact.message_id)
        self._change(fact.id, is_queued=True, module="")

    def _unqueued(self, fact: facts.Unqueued) -> None:
        self._change(fact.id, is_queued=False)

    def _delivered(self, fact: facts.Delivered) -> None:
        self._make_copy(fact.id, fact.message_id)
        self._change(fact.id, is_queued=False, is_begun=True, module=fact.module)

    def _make_copy(self, key: int, original: int) -> None:
        if key not in self.seen:
            self.seen[key] = replace(self.seen[original], id=key, is_over=False)

    def _returned(self, fact: facts.Returned) -> None:
        self._change(fact.id, module="", is_over=not self.seen[fact.id].is_task)

    def _failed(self, fact: facts.Failed) -> None:
        if fact.id in self.seen:
            self._change(fact.id, module="", failure=fact.failure, is_over=not self.seen[fact.id].is_task)

    def _killed(self, fact: facts.Killed) -> None:
        self._change(fact.task, is_killed=True)

    def _dropped(self, fact: facts.Dropped) -> None:
        self._change(fact.id, is_queued=False, is_over=not self.seen[fact.id].is_handled)

    def _joined(self, fact: facts.ModuleJoined) -> None:
        self.modules = (*self.modules, fact.module)

    def _left(self, fact: facts.ModuleLeft) -> None:
        self.modules = tuple(name for name in self.modules if name != fact.module)

    def _reached(self, fact: facts.Reached) -> None:
        task = self.seen[fact.task]
        reached = task.reached | fact.moments
        self._change(task.id, reached=reached, is_over=reached == ALL_MOMENTS)
        self._hold_to_promises(self.seen[task.id], fact.moments)

    # --- promises ----------------------------------------------------------------------------------------------------

    def _hold_to_promises(self, task: Seen, moments: int) -> None:
        too_early = [str(before) for moment, before in task.after
                     if moments & moment and not task.is_killed and not self.is_past(before)]  # fmt: skip
        parent = self.seen.get(task.parent_id)
        if parent is not None and not task.is_killed and moments & _STARTS & ~parent.reached:
            too_early.append(f"the start of {parent}")
        for end in _ENDS:
            if moments & end and task.message_class is MessageClass.GOAL:
                too_early += [f"the end of {child}" for child in self.children(task) if not child.reached & end]
        if too_early:
            words = ", ".join(str(Point(task.id, Moment(moment))) for moment in Moment if moment & moments)  # type: ignore[arg-type]
            self.broken = f"{words} ('{task.message}') came before {', '.join(too_early)}"

    def is_past(self, point: Point) -> bool:
        """Whether a point of a task has been reached."""
        leader = self.seen.get(point.task)
        return leader is None or point.task == ROOT or leader.has(point.moment)


# ruff: noqa: SLF001
_FOLD: dict[type, Callable[[World, Any], None]] = {
    facts.Received: World._received,
    facts.Constrained: World._constrained,
    facts.Queued: World._queued,
    facts.Unqueued: World._unqueued,
    facts.Delivered: World._delivered,
    facts.Returned: World._returned,
    facts.Failed: World._failed,
    facts.Killed: World._killed,
    facts.Dropped: World._dropped,
    facts.Reached: World._reached,
    facts.ModuleJoined: World._joined,
    facts.ModuleLeft: World._left,
}
