"""Every message under way, folded from the facts that central records.

Knows nothing of how central does it. promises.py holds central to its promises with nothing but this; world.py shows
it to properties.
"""

from collections.abc import Callable, Iterable
from typing import Any

from msgspec.structs import replace

from tca_tools.explore.observed import promises
from tca_tools.explore.observed.messages import Situation, TrackedMessage
from tca_tools.explore.observed.states import States
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.journal.takers import takers
from tca_wire.points import ALL_MOMENTS, ROOT, STARTS, Moment, Point, TaskId, start_of
from tca_wire.rules import CONDITIONS
from tca_wire.vocabulary import Condition, Role


class Fold(Situation):
    """The situation after each fact."""

    def __init__(self) -> None:
        super().__init__()
        self.states = States()
        self._tasks: dict[int, int] = {}  #: of deliveries of tasks that are retried
        self._copies: dict[int, int] = {}  #: of what goes to many, and its original
        self._conditions: dict[int, Condition] = {}  #: of wiretaps
        self._capacities: dict[tuple[str, str], int] = {}  #: by module and resource

    def forget_what_is_over(self) -> None:
        """A new action begins."""
        for key, seen in list(self.seen.items()):
            if seen.is_over:
                del self.seen[key]
            elif seen.is_new or seen.is_retried or seen.has_fired:
                self._change(key, is_new=False, is_retried=False, has_fired=False)
        self._tasks = {given: task for given, task in self._tasks.items() if task in self.seen}
        self._copies = {copy: of for copy, of in self._copies.items() if copy in self.seen}
        self.passed = 0.0
        self.taken = None
        self.broken = ""
        self.slots_lost.clear()

    def take(self, recorded: Iterable[facts.Fact]) -> None:
        """Take in what central recorded, now."""
        for fact in recorded:
            self.states.take(fact)
            if do := _FOLD.get(type(fact)):
                do(self, fact)

    def note_states(self) -> None:
        """An action is over: what is known of tasks' states."""
        for number, task in self.states.of.items():
            if number in self.seen and self.seen[number].state != task.state:
                self._change(number, state=task.state)
            if number in self.seen and self.seen[number].body != task.goal:
                self._change(number, body=task.goal)
        self.broken = self.broken or self.states.breach()

    def _change(self, key: int, **changes: Any) -> None:
        if (seen := self.seen.get(key)) is not None:
            self.seen[key] = replace(seen, **changes)

    def _received(self, fact: facts.Received) -> None:
        is_original = fact.message_class.fans_out and not fact.message_class.keeps_value
        parent, about = self.seen.get(fact.parent), self.seen.get(fact.about)
        self.seen[fact.id] = TrackedMessage(
            id=fact.id, message=fact.message, message_class=fact.message_class, sender=fact.sender,
            parent_id=fact.parent, body=fact.body, is_over=is_original, role=fact.role, about=fact.about, is_new=True,
            sent_by=about.sent_by if about is not None else "" if fact.role else fact.sender,
            is_suspended=parent is not None and parent.is_suspended and not fact.role.leaves_safe,
        )  # fmt: skip
        if fact.role is Role.EXCEPTION and (failing := self.seen.get(fact.about)) is not None:
            self._change(fact.about, recovering=(*failing.recovering, fact.id))
        elif fact.role is Role.ACTION:
            self._change(fact.about, has_fired=True)
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

    def _key(self, given: facts.Queued | facts.Delivered) -> int:
        """By which a message is known here; a retried task has another delivery each time."""
        original = self.seen.get(given.message_id)
        if original is not None and original.is_task:
            if given.id != given.message_id:
                self._tasks[given.id] = given.message_id
            return given.message_id
        if original is not None and given.id not in self.seen:
            self.seen[given.id] = replace(original, id=given.id, is_over=False)
            self._copies[given.id] = given.message_id
        return given.id

    def _granted(self, fact: facts.Granted) -> None:
        claim = self.claims[fact.id]
        self.held_by[claim.module, claim.resource] = claim

    def _claim_ended(self, fact: facts.ClaimEnded) -> None:
        claim = self.claims.pop(fact.id)
        if self.held_by.get((claim.module, claim.resource)) is claim:
            del self.held_by[claim.module, claim.resource]

    def _delivered(self, fact: facts.Delivered) -> None:
        key = self._key(fact)
        self.broken = self.broken or promises.delivered(self, self.seen[key], fact)
        self._change(key, is_queued=False, is_begun=True, module=fact.module)

    def begin(self, delivery: int, module: str, resource: str) -> None:
        """A slot begins with a message that it had ahead: central is told of that with its reply."""
        if (message := self.seen.get(delivery)) is not None:
            self.broken = self.broken or promises.kept_out(self, message, module, resource)

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
        """The top-level task has failed, too; or an exception handler could not decide, and is killed."""
        if fact.undecided:
            return
        failing = top = self.seen[fact.task]
        while (parent := self.parent(top)) is not None:
            top = parent
        self._change(top.id, failure=top.failure or failing.failure)

    def _recover(self, handler: TrackedMessage) -> None:
        """An exception handler is at work no longer."""
        if (failing := self.seen.get(handler.about)) is not None:
            self._change(failing.id, recovering=tuple(one for one in failing.recovering if one != handler.id))

    def _recovered(self, fact: facts.Recovered) -> None:
        self.broken = self.broken or promises.recovered(self.seen[fact.task], self.seen.get(fact.handler))
        self._change(fact.task, failure="", is_resolved=True)

    def _retried(self, fact: facts.Retried) -> None:
        task, below = self.seen[fact.task], {int(fact.task)}
        self._change(fact.task, failure="", attempts=task.attempts + task.is_begun, is_retried=True,
                     is_resolved=False, has_resolved=False, body=fact.body or task.body)  # fmt: skip
        for one in self.tasks:  # parents are older than their children
            if one.parent_id in below:
                below.add(one.id)
                self._change(one.id, has_resolved=one.role is Role.EXCEPTION)

    def _suspended(self, fact: facts.SuspendedOrResumed) -> None:
        below = {int(fact.task)}
        for task in self.tasks:  # parents are older than their children
            if task.id in below or task.parent_id in below:
                below.add(task.id)
                self._change(task.id, is_suspended=fact.is_suspended)

    def _dropped(self, fact: facts.Dropped) -> None:
        for dropped in [fact.id, *(copy for copy, of in self._copies.items() if of == fact.id)]:
            if dropped in self.seen:
                self._change(dropped, is_queued=False, is_over=not self.seen[dropped].is_handled)

    def _tap_fired(self, fact: facts.TapFired) -> None:
        listener, tapped = self.seen.get(fact.listener), self.seen.get(fact.tapped)
        if listener is None or tapped is None or not (listener.is_task and tapped.is_task):
            return
        rule = CONDITIONS[self._conditions[fact.tap]]
        if rule.holds_until:
            point = Point(TaskId(listener.id), Moment(rule.holds_until))
            self._change(tapped.id, after=(*tapped.after, (rule.before, point)))

    def _resource_changed(self, fact: facts.ResourceChanged) -> None:
        """Where a slot is gone, what it had not begun may go to another."""
        key = fact.module, fact.resource
        if fact.capacity < self._capacities.get(key, 0):
            self.slots_lost.add(fact.module)
        self._capacities[key] = fact.capacity

    def _joined(self, fact: facts.ModuleJoined) -> None:
        self.modules = (*self.modules, fact.module)

    def _left(self, fact: facts.ModuleLeft) -> None:
        self.modules = tuple(name for name in self.modules if name != fact.module)

    def _killed(self, task: TaskId) -> None:
        never_began = STARTS & ~self.seen[task].reached
        self._change(task, is_killed=True, is_suspended=False, never_began=never_began)

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

    def _begin_delays(self, follower: TrackedMessage, fact: facts.Reached) -> None:
        """Begin the delays after the moments that were just reached."""
        begun = [one for one in follower.delayed if one[1].task == fact.task and one[1].moment & fact.moments]
        unbegun = self.seen[fact.task].never_began
        times = [(one, self.now + delay) for one, point, delay in begun if not start_of(point.moment) & unbegun]
        self._change(follower.id, not_before=(*follower.not_before, *times),
                     delayed=tuple(one for one in follower.delayed if one not in begun))  # fmt: skip


# ruff: noqa: SLF001
_FOLD: dict[type, Callable[[Fold, Any], None]] = {
    **takers(Fold),
    facts.Claimed: lambda fold, fact: fold.claims.update({fact.id: fact}),
    facts.Constrained: lambda fold, fact: fold._constrain(fact.constraints),
    facts.Queued: lambda fold, fact: fold._change(fold._key(fact), is_queued=True, module=""),
    facts.Unqueued: lambda fold, fact: fold._change(fold._tasks.get(fact.id, fact.id), is_queued=False),
    facts.Reissued: lambda fold, fact: fold._recover(fold.seen[fact.handler]),
    facts.Resolved: lambda fold, fact: fold._change(fact.handler, has_resolved=True),
    facts.Killed: lambda fold, fact: fold._killed(fact.task),
    facts.TapAdded: lambda fold, fact: fold._conditions.update({fact.id: fact.condition}),
}
