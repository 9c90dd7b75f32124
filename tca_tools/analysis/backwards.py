"""The causes of any moment of a run: backwards through whatever was waited for last. Pure.

Theory. An entry of the journal holds all that one event brought about, and no two entries have the
same time. So the cause of what happened at a time is the event of that entry, and the entry says
who asked for it: the run of a handler, which returned or sent something, a program outside of
handlers, or nobody, if a time was due. A handler had worked since it was given its message, or
since it last resumed from a wait; the event of *that* entry let it begin or resume; and so on, back
to where somebody acted of his own will. What was cut off before it came to its end leads to what it
waited for just then. Each step goes back in time, so a walk costs what it passes through.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf, nextafter
from operator import itemgetter
from typing import NamedTuple

from tca_tools.analysis.steps import Doing, PathStep, delay_of
from tca_tools.explain.graph import Ends, further, keeping, steps, waits_now
from tca_tools.explain.wait_words import wait_for
from tca_tools.explain.waits import Node, Wait, has_come, node_of
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.coordinators import ends_waited_for
from tca_tools.journal.records import (
    Claim,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Queueing,
    Suspension,
    Task,
)
from tca_tools.journal.whole_run import Run
from tca_wire.points import END_ACHIEVING, Moment
from tca_wire.text.waits_in_words import in_words
from tca_wire.vocabulary import Role
from tca_wire.waits import WaitKind


@dataclass(slots=True)
class _At:
    """Where a walk stands: before *time*, in the run of a handler; or (None) at what happened to a
    message then.
    """

    time: float
    message_id: int
    handling: Handling | None = None
    wait: HandlerWait | None = None
    """The wait that was over then, if the walk came by one."""


_Over = tuple[float, float, HandlerWait]
"""When a wait was over, and what had come last by then: when, and the wait for that."""
_END = itemgetter(0)
_Back = tuple[PathStep | None, _At | None]
_Since = Callable[[PathStep], float | None]
"""A step back, if it took time, and where the walk stands before it; None where it begins."""


class Causes:
    """The causes of a run's events."""

    def __init__(self, run: Run) -> None:
        self._run = run
        granted = (claim for claim in run.claims.values() if claim.granted is not None)
        self._released = {claim.end: claim for claim in granted if claim.end is not None}
        self._returned: dict[tuple[int, float | None], Handling] = {}  # a task may have thousands
        for message in run.messages.values():
            self._returned.update(((one.message_id, one.end), one) for one in message.handlings)
        self._outside = {
            name: self._as_ended(one.waits, is_outside=True) for name, one in run.modules.items()
        }
        self._over: dict[int, list[_Over]] = {}
        """The waits of handlers that were walked through, by their ends."""

    def back_from(
        self, time: float, message_id: int = 0, handling: Handling | None = None
    ) -> Iterator[PathStep]:
        """The steps that led to what happened at *time* to a message, or that a handler did then;
        the newest first.
        """
        return self._back(_At(time, message_id, handling), lambda _: None)

    def back_before(self, step: PathStep, since: _Since) -> Iterator[PathStep]:
        """The steps before *step*, newest first, as if there had been no waits before those for
        which *since* says from when on they waited: from there the walk goes on with who waited,
        not with what he waited for.
        """
        start = since(step)
        return self._back(_before(step, step.start if start is None else start), since)

    def _back(self, first: _At, since: _Since) -> Iterator[PathStep]:
        at: _At | None = first
        seen = set()
        while at is not None:
            place = at.time, at.message_id, id(at.handling)
            if place in seen:
                return
            seen.add(place)
            run = at.handling
            step, at = self._in_handler(at, run) if run else self._at_event(at)
            if step is not None and step.end > step.start:
                yield step
                if (start := since(step)) is not None:
                    at = _before(step, start)

    def _in_handler(self, at: _At, handling: Handling) -> _Back:
        """Back to where the handler last resumed, or else began."""
        if (over := self._over.get(id(handling))) is None:
            ends = ends_waited_for(self._run, handling)
            waits = list(handling.waits)
            if ends:  # any news wakes it
                waits = [wait for wait in waits if wait.kind is not WaitKind.CHANGE]
            over = self._over[id(handling)] = self._as_ended([*waits, *ends])
        place = bisect_right(over, at.time, key=_END)
        start, wait = over[place - 1][1:] if place else (handling.start, None)
        number, where = handling.message_id, (handling.module, handling.resource)
        step = PathStep(start, at.time, Doing.WORK, number, *where, handling, wait)
        return step, _At(start, wait.awaited if wait else number, wait=wait)

    def _as_ended(self, waits: Sequence[HandlerWait], *, is_outside: bool = False) -> list[_Over]:
        """Waits that are over, as they ended. What takes no time is over with the event that begins
        it; but a program outside of handlers that looks so at the end of a task had to wait until
        that came. A wait in vain for a change let nothing go on, nor did one that another's end had
        ended, of the first of several tasks.
        """
        found: list[_Over] = []
        ended = [(wait.end, wait) for wait in waits if wait.end is not None]
        for end, wait in sorted(ended, key=_END):
            if wait.kind is WaitKind.PRESENCE:
                continue  # who came is told nowhere
            is_late = wait.kind is WaitKind.CHANGE or (found and found[-1][0] >= wait.start)
            if is_late and not has_come(self._run, wait):
                continue
            since = end
            if wait.start == end:
                task = self._run.tasks.get(wait.awaited)
                if is_outside and task is not None and wait.moment:
                    since = task.time_of(wait.moment)
                if since >= end:
                    continue
            is_last = not found or since >= found[-1][1]
            found.append((end, since, wait) if is_last else (end, *found[-1][1:]))
        return found

    # --- events and their origins -----------------------------------------------------------------

    def _at_event(self, at: _At) -> _Back:
        """Of a message, a lock or a wait that was over then."""
        message = self._run.messages.get(at.message_id)
        if isinstance(message, Task) and (stood := _resumed(message, at.time)):
            return stood, _At(stood.start, stood.message_id)
        if (ended := self._asker(at, message)) is not None:
            return None, _At(at.time, at.message_id, ended)
        if message is not None and message.received == at.time and not message.role:
            return self._by(message.sender, message.by, message.id, at.time)
        if (found := self._at_claim(at)) is not None:
            return found
        if message is not None:
            return self._without_asker(message, at)
        return (None, None) if at.wait is None else self._in_vain(at.wait, at.time)

    def _asker(self, at: _At, message: Message | None) -> Handling | None:
        """The handler that returned then, or asked for what happened; one that was cut off while it
        waited did nothing. Of several that were lost with their module it is that of the message.
        """
        own = self._returned.get((message.id, at.time)) if message else None
        ended = own or self._run.asker_at(at.time)
        if not isinstance(ended, Handling) or (at.wait is not None and ended is at.wait.by):
            return None
        return ended if ended.start < at.time else None

    def _by(self, module: str, by: Handling | None, number: int, time: float) -> _Back:
        """Back into the handler that did something; or to where the program last waited, outside of
        any handler.
        """
        if by is not None and by.start < time <= by.until:
            return None, _At(time, number, by)
        if by is not None and by.end is not None and by.end < time:  # beside it
            step = PathStep(by.end, time, Doing.OUTSIDE, number, module)
            return step, _At(by.end, by.message_id, by)
        outside = self._outside.get(module, []) if by is None else []
        if not (place := bisect_left(outside, time, key=_END)):
            return None, None
        _, start, wait = outside[place - 1]
        step = PathStep(start, time, Doing.OUTSIDE, number, module, resumed=wait)
        return step, _At(start, wait.awaited, wait=wait)

    def _at_claim(self, at: _At) -> _Back | None:
        """Back into who had a lock until then; or from a lock that was wanted until then, to where
        it was asked for.
        """
        time, number = at.time, at.message_id
        wanted, held = self._run.claims.get(number), self._released.get(time)
        since = held.granted if held is not None and held is not wanted else None
        if held is None or since is None or since >= time:
            return None if wanted is None else self._wanted(wanted, time)
        if held.by is not None and held.by.start < time <= held.by.until:
            return None, _At(time, number, held.by)
        return PathStep(since, time, Doing.LOCKED, number, held.sender), _At(since, held.id)

    def _wanted(self, claim: Claim, time: float) -> _Back:
        """Back to where a lock was asked for: nothing is known that let it be granted, or it was
        wanted in vain.
        """
        if claim.start >= time:
            return self._by(claim.sender, claim.by, claim.id, time)
        number = claim.by.message_id if claim.by else claim.id
        where = claim.module, claim.resource
        step = PathStep(claim.start, time, Doing.LOCKED, number, *where)
        return step, _At(claim.start, claim.id)

    # --- events without an origin: a time was due, or a cut-off -----------------------------------

    def _without_asker(self, message: Message, at: _At) -> _Back:
        time, number = at.time, message.id
        if message.role in (Role.CONDITION, Role.ACTION) and message.received == time:
            return self._monitored(message, time)
        for queueing in (*message.queueings, *self._run.copies.get(number, ())):
            if queueing.end == time and queueing.start < time:
                doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
                where = queueing.module, queueing.resource
                step = PathStep(queueing.start, time, doing, number, *where)
                return step, _At(queueing.start, number)
        if isinstance(message, Task):
            for hold in message.holds:
                if hold.over == time:
                    return self._delayed(message, hold, time)
        if message.received == time:
            is_known = message.about in self._run.messages
            return None, _At(time, message.about) if is_known else None
        return self._cut_off(message, at)

    def _delayed(self, task: Task, hold: Hold, time: float) -> _Back:
        """Back over a delay; if its point was late, to where it was asked for."""
        start, cause = delay_of(self._run, task, hold)
        start = start if start < time else min(hold.added, time)
        return PathStep(start, time, Doing.DELAY, task.id), _At(start, cause)

    def _monitored(self, message: Message, time: float) -> _Back:
        """Central asks a monitor's condition, or sends its action, when the time has come: back to
        its start.
        """
        monitor = self._run.tasks.get(message.about)
        if monitor is None:
            return None, None
        start = monitor.reached.get(Moment.START_HANDLING, monitor.received)
        if start >= time:
            return None, _At(time, monitor.id)
        return PathStep(start, time, Doing.WATCHING, monitor.id), _At(start, monitor.id)

    def _cut_off(self, message: Message, at: _At) -> _Back:
        """It was killed or suspended then, or somebody no longer waited for it: back to what it
        waited for itself.
        """
        time = at.time
        if (back := self._going_on(message, time)) is not None:
            return back
        was_killed = time in (message.written("killed", time), message.written("failure", time))
        if at.wait is not None and at.wait.start < time and not was_killed:
            return self._in_vain(at.wait, time)
        since = last_change(self._run, message, time)
        doing = Doing.KILLED if was_killed else Doing.UNKNOWN
        return PathStep(since, time, doing, message.id), _At(since, message.id)

    def _going_on(self, message: Message, time: float) -> _Back | None:
        """Back to what something waited for just before a time."""
        found = going_on(RunAt(self._run, nextafter(time, 0.0)), message, time)
        if found is None:
            return None
        since = found.standing.start if found.standing else time
        return found.standing, _At(since, found.message_id, found.handling)

    def _in_vain(self, wait: HandlerWait, time: float) -> _Back:
        """Nothing is known that ended a wait: back to where it began."""
        if (claim := self._run.claims.get(wait.awaited)) is not None:
            return self._wanted(claim, time)
        message = self._run.messages.get(wait.awaited)
        if message is not None and (back := self._going_on(message, time)) is not None:
            return back
        step, by = PathStep(wait.start, time, Doing.UNKNOWN, wait.awaited), wait.by
        if isinstance(by, Handling):
            return step, _At(wait.start, by.message_id, by)
        return step, _At(wait.start, wait.awaited)


def _resumed(task: Task, time: float) -> PathStep | None:
    """The part of a suspension that was over then in which nothing ran any more."""
    for one in task.suspensions:
        if one.end == time and (since := one.standstill) is not None and since < time:
            return PathStep(since, time, Doing.SUSPENDED, one.cause)
    return None


def _before(step: PathStep, since: float) -> _At:
    """Where a walk goes on that leaves out the wait before a step: in its handler, or where it was
    put into a queue.
    """
    return _At(since, step.message_id, step.handling if step.resumed else None)


# --- what keeps something at a moment -------------------------------------------------------------

# A walk follows all that a task waits for, each thing once. What is under it counts first; where
# nothing there goes on, its constraints, and its handlers that wait, lead to tasks elsewhere.


class GoingOn(NamedTuple):
    """The node that a task waits for at a moment."""

    node: Node
    is_elsewhere: bool
    """Whether it is not under the task."""
    message_id: int
    """The message that runs; or at whose event something came to stand."""
    handling: Handling | None
    """The handler that went on until then."""
    standing: PathStep | None
    """The step that stands; None: it runs."""

    def rank(self) -> tuple[bool, bool, float]:
        """The order of causes: the least counts first."""
        step = self.standing
        watches = step is not None and step.doing is Doing.WATCHING
        return watches, self.is_elsewhere, step.start if step else -inf


def going_on(at: RunAt, message: Message, until: float) -> GoingOn | None:
    """The cause of a wait *until* just after a moment: runs come before standstills, and these
    before monitors that watch; of standstills the longest. None if nothing is known.
    """
    return _WaitWalk(at, message, until).first() or _circle(at, message, until)


def at_last(run: Run, task: Task) -> tuple[GoingOn, list[str]]:
    """The cause of an open task's wait when the journal ends; and if it is not under the task, the
    waits that lead there, in words. If it is not known, since when nothing happened under the task.
    """
    at = RunAt(run)
    walk = _WaitWalk(at, task, run.time)
    if (found := walk.first()) is not None:
        return found, walk.way_to(found.node) if found.is_elsewhere else []
    if (found := _circle(at, task, run.time)) is not None:
        return found, []
    is_held = waits_now(at, task.id) and not task.handling
    doing = Doing.HELD if is_held else Doing.UNKNOWN
    step = PathStep(last_change(run, task, inf), run.time, doing, task.id)
    return GoingOn(Node(task.id), False, task.id, None, step), []


def _circle(at: RunAt, message: Message, until: float) -> GoingOn | None:
    """The circle of waits that keeps something, since it was closed; None if there is none."""
    run, ends, later = at.run, Ends.at(at), nextafter(at.moment, inf)
    found = next(iter(ends.of(message.id)), None)
    if found is None or found.kind is not WaitKind.CIRCLE:
        return None
    members = [run.messages[one] for one in ends.members(found) if one in run.messages]
    closed, member = max((last_change(run, one, later), one.id) for one in members)
    step = PathStep(closed, until, Doing.CIRCLE, member)
    return GoingOn(Node(member), member != message.id, member, None, step)


def last_change(run: Run, message: Message, before: float) -> float:
    """When something last happened to a message or to what is under it: a new state, or a handler
    waits or is done.
    """
    below = [*run.under(message)] if isinstance(message, Task) else []
    handlings = [one for each in (message, *below) for one in each.handlings]
    times = [time for one in below for time, _ in one.states]
    times += [wait.start for one in handlings for wait in one.waits]
    times += [one.end for one in handlings if one.end is not None]
    return max((time for time in times if time < before), default=message.received)


class _Way(NamedTuple):
    """How a walk came to a node."""

    before: Node | None
    wait: Wait | None
    is_elsewhere: bool


class _WaitWalk:
    """From a task to all that it waits for, and what that waits for."""

    def __init__(self, at: RunAt, message: Message, until: float) -> None:
        self._at, self._until = at, until
        under = at.run.under(message) if isinstance(message, Task) else [message]
        self._own = {one.id for one in under}
        self._found: list[GoingOn] = []
        start = Node(message.id, END_ACHIEVING if isinstance(message, Task) else 0)
        self._ways, self._nodes = {start: _Way(None, None, False)}, [start]
        for node in self._nodes:  # grows while it is walked
            if (claim := at.run.claims.get(node.number)) is not None:
                self._at_claim(node, claim)
                continue
            for wait in keeping(at, node):
                for other in further(at, wait):
                    self._come_to(other, node, wait)
                self._end(node, wait)

    def first(self) -> GoingOn | None:
        """The cause that counts first; None if none is known."""
        return min(self._found, key=GoingOn.rank, default=None)

    def way_to(self, node: Node) -> list[str]:
        """The waits that lead to a node, in words."""
        words = list[str]()
        for before, wait in self._back_from(node):
            if wait is not None and wait.kind is not WaitKind.SUBTASK:
                who = "the handler of " * isinstance(wait.record, HandlerWait)
                who += self._at.describe(before.number)
                words.insert(0, f"{who} waits {in_words(wait_for(self._at, wait))}")
        return words

    def _back_from(self, node: Node) -> Iterator[tuple[Node, Wait | None]]:
        """The nodes by which the walk came to one, and their waits, back to the first."""
        while (way := self._ways[node]).before is not None:
            yield way.before, way.wait
            node = way.before

    def _come_to(self, node: Node, before: Node, wait: Wait | None) -> None:
        if node not in self._ways:
            is_elsewhere = node.number not in self._own
            if wait is not None and wait.kind is WaitKind.REPLY:
                is_elsewhere = self._ways[before].is_elsewhere
            self._ways[node] = _Way(before, wait, is_elsewhere)
            self._nodes.append(node)

    def _at_claim(self, node: Node, claim: Claim) -> None:
        """Follow a lock to all that its holder waits for; or to the program that has it, outside of
        handlers.
        """
        others, _ = steps(self._at, node)
        for other in others:
            self._come_to(other, node, None)
        if others or not self._at.is_granted(claim) or (wait := self._handler_wait(node)) is None:
            return
        since = max(wait.start, claim.granted or 0.0)
        handling = wait.by if isinstance(wait.by, Handling) else None
        number = handling.message_id if handling else 0
        step = PathStep(since, self._until, Doing.LOCKED, number, claim.sender)
        self._find(node, number, handling if since == wait.start else None, step)

    def _handler_wait(self, node: Node) -> HandlerWait | None:
        """The last wait of a handler on the way to a node."""
        records = (wait.record for _, wait in self._back_from(node) if wait is not None)
        return next((one for one in records if isinstance(one, HandlerWait)), None)

    def _end(self, node: Node, wait: Wait) -> None:
        """Note what waits for nothing else: it runs, or stands."""
        record, number, until = wait.record, node.number, self._until
        if wait.kind is WaitKind.RUNNING and isinstance(record, Handling):
            self._find(node, record.message_id, record)
        elif isinstance(record, Queueing):
            doing = Doing.QUEUED if record.module else Doing.NO_HANDLER
            step = PathStep(record.start, until, doing, number, record.module, record.resource)
            self._find(node, number, step=step)
        elif wait.kind is WaitKind.DELAY and isinstance(record, Hold):
            start, cause = delay_of(self._at.run, self._at.run.tasks[number], record)
            self._find(node, cause, step=PathStep(start, until, Doing.DELAY, number))
        elif isinstance(record, Suspension):
            self._suspended(node, wait, record)
        elif wait.kind is WaitKind.CONDITION:
            self._find(node, number, step=PathStep(wait.start, until, Doing.WATCHING, number))

    def _suspended(self, node: Node, wait: Wait, suspension: Suspension) -> None:
        """What is suspended stands, or handlers under it still run."""
        since, cause, now = suspension.standstill, suspension.cause, self._at.moment
        if since is not None and since <= now:
            self._find(node, cause, step=PathStep(since, self._until, Doing.SUSPENDED, cause))
            return
        for run in suspension.still:
            if run.start <= now < run.until:
                self._come_to(node_of(self._at.run, run), node, wait)

    def _find(
        self,
        node: Node,
        message_id: int,
        handling: Handling | None = None,
        step: PathStep | None = None,
    ) -> None:
        is_elsewhere = self._ways[node].is_elsewhere
        self._found.append(GoingOn(node, is_elsewhere, message_id, handling, step))
