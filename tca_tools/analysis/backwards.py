"""The causes at any instant of a run: a walk backwards through the last wait of each step. Pure.

Theory. An entry of the journal contains all facts that one event caused, and no two entries have
the same time. The cause of a fact is therefore the event of its entry. The entry names the event's
origin: the run of a handler, or a program outside of handlers. An event without an origin happened
because a time was due.

The handler of the origin had been working since it started, or since it last resumed after a wait.
An earlier entry let the handler start or resume. That entry has an origin, too, and so on, back to
a program that acted on its own. If a handling was cut off, the walk continues with the wait of its
message at that time. Each step goes back in time, so the cost of a walk is proportional to the
number of its steps.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf, nextafter
from operator import itemgetter
from typing import NamedTuple

from tca_tools.analysis.steps import Doing, PathStep, delay_of
from tca_tools.explain.graph import Ends, awaited_nodes, blocking_waits, prerequisites, waits_now
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
class _Position:
    """The position of a walk: in a handling before *time*, or at an event of a message."""

    time: float
    message_id: int
    handling: Handling | None = None
    """The run of the handler; None at an event."""
    wait: HandlerWait | None = None
    """The wait whose end, at ``time``, led the walk here; None if the walk came another way."""


_EndedWait = tuple[float, float, HandlerWait]
"""The end of a wait, the time of the newest event that was awaited until then, and the wait for
that event. The third is this wait or an earlier one.
"""
_END = itemgetter(0)
_StepBack = tuple[PathStep | None, _Position | None]
"""A step back and the position before it. The step is None if no step was needed to get there. The
position is None where the walk ends.
"""
_WaitStart = Callable[[PathStep], float | None]
"""A function of a step: the start of the wait before it if the walk skips that wait, else None."""


class Causes:
    """The causes of a run's events."""

    def __init__(self, run: Run) -> None:
        self._run = run
        granted = (claim for claim in run.claims.values() if claim.granted is not None)
        self._released = {claim.end: claim for claim in granted if claim.end is not None}
        # A table, since a task may have thousands of handlings
        self._returned: dict[tuple[int, float | None], Handling] = {}
        for message in run.messages.values():
            self._returned.update(((one.message_id, one.end), one) for one in message.handlings)
        self._outside = {
            name: self._ended_waits(one.waits, is_outside=True) for name, one in run.modules.items()
        }
        self._in_handlers: dict[int, list[_EndedWait]] = {}
        """By identity of a handling that a walk has passed: its ended waits."""

    def back_from(
        self, time: float, message_id: int = 0, handling: Handling | None = None
    ) -> Iterator[PathStep]:
        """Yield the steps that led to an event of a message, or to an act of a handler.

        Args:
            time: The time of the event; the newest step ends there.
            message_id: The message.
            handling: The run of the handler that acted; None for an event of the message.
        """
        return self._back(_Position(time, message_id, handling), lambda _: None)

    def back_before(self, step: PathStep, since: _WaitStart) -> Iterator[PathStep]:
        """Yield the steps before a step, newest first, as if some waits had not been necessary.

        Args:
            step: The step from which the walk starts.
            since: Returns the start of the wait before a step if the walk skips that wait, else
                None. After a skip the walk continues at that start with the message or handler that
                waited, not with the awaited one.
        """
        start = since(step)
        return self._back(_position_before(step, step.start if start is None else start), since)

    def _back(self, first: _Position, since: _WaitStart) -> Iterator[PathStep]:
        here: _Position | None = first
        seen = set()
        while here is not None:
            key = here.time, here.message_id, id(here.handling)
            if key in seen:  # steps that take no time may lead in a circle
                return
            seen.add(key)
            step, here = (
                self._in_handler(here, here.handling) if here.handling else self._at_event(here)
            )
            if step is not None and step.end > step.start:
                yield step
                if (start := since(step)) is not None:
                    here = _position_before(step, start)

    def _in_handler(self, here: _Position, handling: Handling) -> _StepBack:
        """Go back to where the handler last resumed, or else started."""
        if (ended := self._in_handlers.get(id(handling))) is None:
            ends = ends_waited_for(self._run, handling)
            waits = list(handling.waits)
            if ends:  # a coordinator waits for any change: only the ends of its tasks are causes
                waits = [wait for wait in waits if wait.kind is not WaitKind.CHANGE]
            ended = self._in_handlers[id(handling)] = self._ended_waits([*waits, *ends])
        place = bisect_right(ended, here.time, key=_END)
        start, wait = ended[place - 1][1:] if place else (handling.start, None)
        number, where = handling.message_id, (handling.module, handling.resource)
        step = PathStep(start, here.time, Doing.WORK, number, *where, handling, wait)
        return step, _Position(start, wait.awaited if wait else number, wait=wait)

    def _ended_waits(
        self, waits: Sequence[HandlerWait], *, is_outside: bool = False
    ) -> list[_EndedWait]:
        """Return the ended waits that let their handler or program resume, sorted by their ends.

        Waits for the presence of a module are left out. So are waits in vain for a change, and
        waits in a handler that took no time. A handler may also wait for the first of several
        tasks. Then only the wait for the task that ended counts.

        Outside of handlers, a wait that took no time counts if it was for a task that had ended
        before. The program read the task's result, and could not have done so before that end.
        """
        found: list[_EndedWait] = []
        ended = [(wait.end, wait) for wait in waits if wait.end is not None]
        for end, wait in sorted(ended, key=_END):
            if wait.kind is WaitKind.PRESENCE:
                continue  # the journal does not say which module ended it
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

    def _at_event(self, here: _Position) -> _StepBack:
        """Go back from an event of a message, a lock or a wait."""
        message = self._run.messages.get(here.message_id)
        if isinstance(message, Task) and (step := _resumed(message, here.time)):
            return step, _Position(step.start, step.message_id)
        if (asker := self._asker(here, message)) is not None:
            return None, _Position(here.time, here.message_id, asker)
        if message is not None and message.received == here.time and not message.role:
            return self._to_sender(message.sender, message.by, message.id, here.time)
        if (back := self._at_claim(here)) is not None:
            return back
        if message is not None:
            return self._without_asker(message, here)
        return (None, None) if here.wait is None else self._over_wait(here.wait, here.time)

    def _asker(self, here: _Position, message: Message | None) -> Handling | None:
        """Return the handler that returned at an event, or that requested the event; else None.

        A handler that was cut off while it waited does not count, since it did nothing. If several
        handlers were lost with their module, the handler of the message is returned.
        """
        own = self._returned.get((message.id, here.time)) if message else None
        asker = own or self._run.asker_at(here.time)
        if not isinstance(asker, Handling) or (here.wait is not None and asker is here.wait.by):
            return None
        return asker if asker.start < here.time else None

    def _to_sender(self, module: str, by: Handling | None, number: int, time: float) -> _StepBack:
        """Go back into the sending handler, or over the sender's work outside of handlers."""
        if by is not None and by.start < time <= by.until:
            return None, _Position(time, number, by)
        if by is not None and by.end is not None and by.end < time:  # sent after it had returned
            step = PathStep(by.end, time, Doing.OUTSIDE, number, module)
            return step, _Position(by.end, by.message_id, by)
        outside = self._outside.get(module, []) if by is None else []
        if not (place := bisect_left(outside, time, key=_END)):
            return None, None
        _, start, wait = outside[place - 1]
        step = PathStep(start, time, Doing.OUTSIDE, number, module, resumed=wait)
        return step, _Position(start, wait.awaited, wait=wait)

    def _at_claim(self, here: _Position) -> _StepBack | None:
        """Go back over a lock that was released at an event, or over the wait for a lock."""
        time, number = here.time, here.message_id
        wanted, held = self._run.claims.get(number), self._released.get(time)
        since = held.granted if held is not None and held is not wanted else None
        if held is None or since is None or since >= time:
            return None if wanted is None else self._to_request(wanted, time)
        if held.by is not None and held.by.start < time <= held.by.until:
            return None, _Position(time, number, held.by)
        return PathStep(since, time, Doing.LOCKED, number, held.sender), _Position(since, held.id)

    def _to_request(self, claim: Claim, time: float) -> _StepBack:
        """Go back to the request for a lock that was not granted, or was for an unknown reason."""
        if claim.start >= time:
            return self._to_sender(claim.sender, claim.by, claim.id, time)
        number = claim.by.message_id if claim.by else claim.id
        where = claim.module, claim.resource
        step = PathStep(claim.start, time, Doing.LOCKED, number, *where)
        return step, _Position(claim.start, claim.id)

    # --- events without an origin: a time was due, or a cut-off -----------------------------------

    def _without_asker(self, message: Message, here: _Position) -> _StepBack:
        time, number = here.time, message.id
        if message.role in (Role.CONDITION, Role.ACTION) and message.received == time:
            return self._to_monitor(message, time)
        for queueing in (*message.queueings, *self._run.copies.get(number, ())):
            if queueing.end == time and queueing.start < time:
                doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
                where = queueing.module, queueing.resource
                step = PathStep(queueing.start, time, doing, number, *where)
                return step, _Position(queueing.start, number)
        if isinstance(message, Task):
            for hold in message.holds:
                if hold.over == time:
                    return self._over_delay(message, hold, time)
        if message.received == time:
            is_known = message.about in self._run.messages
            return None, _Position(time, message.about) if is_known else None
        return self._from_cut_off(message, here)

    def _over_delay(self, task: Task, hold: Hold, time: float) -> _StepBack:
        """Go back over a delay to its start; to its request if it did not start before *time*."""
        start, cause = delay_of(self._run, task, hold)
        start = start if start < time else min(hold.added, time)
        return PathStep(start, time, Doing.DELAY, task.id), _Position(start, cause)

    def _to_monitor(self, message: Message, time: float) -> _StepBack:
        """Go back from a monitor's query or action to the start of the monitor."""
        monitor = self._run.tasks.get(message.about)
        if monitor is None:
            return None, None
        start = monitor.reached.get(Moment.START_HANDLING, monitor.received)
        if start >= time:
            return None, _Position(time, monitor.id)
        return PathStep(start, time, Doing.WATCHING, monitor.id), _Position(start, monitor.id)

    def _from_cut_off(self, message: Message, here: _Position) -> _StepBack:
        """Go back to the wait of a message that a kill, a suspension or a timeout cut off."""
        time = here.time
        if (back := self._to_wait_cause(message, time)) is not None:
            return back
        was_killed = time in (
            message.written_at("killed", time),
            message.written_at("failure", time),
        )
        if here.wait is not None and here.wait.start < time and not was_killed:
            return self._over_wait(here.wait, time)
        since = last_change(self._run, message, time)
        doing = Doing.KILLED if was_killed else Doing.UNKNOWN
        return PathStep(since, time, doing, message.id), _Position(since, message.id)

    def _to_wait_cause(self, message: Message, time: float) -> _StepBack | None:
        """Go back to the cause of a message's wait just before a time."""
        found = wait_cause(RunAt(self._run, nextafter(time, 0.0)), message, time)
        if found is None:
            return None
        since = found.standstill.start if found.standstill else time
        return found.standstill, _Position(since, found.message_id, found.handling)

    def _over_wait(self, wait: HandlerWait, time: float) -> _StepBack:
        """Go back over a wait in vain to its start."""
        if (claim := self._run.claims.get(wait.awaited)) is not None:
            return self._to_request(claim, time)
        message = self._run.messages.get(wait.awaited)
        if message is not None and (back := self._to_wait_cause(message, time)) is not None:
            return back
        step, by = PathStep(wait.start, time, Doing.UNKNOWN, wait.awaited), wait.by
        if isinstance(by, Handling):
            return step, _Position(wait.start, by.message_id, by)
        return step, _Position(wait.start, wait.awaited)


def _resumed(task: Task, time: float) -> PathStep | None:
    """Return the standstill of a suspension that ended at a time."""
    for one in task.suspensions:
        if one.end == time and (since := one.standstill) is not None and since < time:
            return PathStep(since, time, Doing.SUSPENDED, one.cause)
    return None


def _position_before(step: PathStep, since: float) -> _Position:
    """Return the position at *since*, the start of the wait before a step.

    If the handler waited, the position is in the handler. If the message was queued, the position
    is at the event that queued it.
    """
    return _Position(since, step.message_id, step.handling if step.resumed else None)


# --- the cause of a wait at an instant ------------------------------------------------------------

# This walk visits the nodes for which a task waits, the nodes for which those wait, and so on, each
# node once. Constraints and waiting handlers may lead the walk out of the task's subtree. A cause
# that is found outside is less important than one inside.


class WaitCause(NamedTuple):
    """The end of a chain of waits at an instant: a node that runs, or that stands still."""

    node: Node
    is_elsewhere: bool
    """Whether the node is outside of the waiting task's subtree."""
    message_id: int
    """The message that runs, or whose event started the standstill."""
    handling: Handling | None
    """The handler that runs, or that ran until the standstill; None if an event started it."""
    standstill: PathStep | None
    """The step in which nothing ran; None if the node was running."""

    def rank(self) -> tuple[bool, bool, float]:
        """Return the sort key: the least is the most important cause."""
        step = self.standstill
        is_watching = step is not None and step.doing is Doing.WATCHING
        return is_watching, self.is_elsewhere, step.start if step else -inf


def wait_cause(at: RunAt, message: Message, until: float) -> WaitCause | None:
    """Return the cause of a message's wait at an instant; None if it is unknown.

    The wait ended at *until*, just after the instant. Of several causes, a watching monitor comes
    last, and a cause outside of the subtree just before it. Of the others, a running handler comes
    first, then the longest standstill.
    """
    walk = _WaitWalk(at, message, until)
    return walk.first() or _cycle(at, message, until, walk.nodes)


def cause_at_end(run: Run, task: Task) -> tuple[WaitCause, list[str]]:
    """Return the cause of an open task's wait at the end of the journal.

    The list describes the waits that lead to a cause outside of the task's subtree; else it is
    empty. If no cause is known, the standstill since the last change under the task is returned.
    """
    at = RunAt(run)
    walk = _WaitWalk(at, task, run.time)
    if (found := walk.first()) is not None:
        return found, walk.path_to(found.node) if found.is_elsewhere else []
    if (found := _cycle(at, task, run.time, walk.nodes)) is not None:
        return found, []
    is_held = waits_now(at, task.id) and not task.handling
    doing = Doing.HELD if is_held else Doing.UNKNOWN
    step = PathStep(last_change(run, task, inf), run.time, doing, task.id)
    return WaitCause(Node(task.id), False, task.id, None, step), []


def _cycle(at: RunAt, message: Message, until: float, nodes: list[Node]) -> WaitCause | None:
    """Return the cycle of waits that blocks a message; None if no cycle does.

    *nodes* are those for which the message waits. A handler that continues under a suspended task
    may be in a cycle, although the waits of the message end at the suspension.

    Its standstill starts with the last change of a member, since that change closed the cycle.
    """
    run, ends, later = at.run, Ends.at(at), nextafter(at.instant, inf)
    firsts = (next(iter(ends.of_node(one)), None) for one in nodes)
    found = next((one for one in firsts if one and one.kind is WaitKind.CIRCLE), None)
    if found is None:
        return None
    members = [run.messages[one] for one in ends.members(found) if one in run.messages]
    closed, member = max((last_change(run, one, later), one.id) for one in members)
    step = PathStep(closed, until, Doing.CIRCLE, member)
    return WaitCause(Node(member), member != message.id, member, None, step)


def last_change(run: Run, message: Message, before: float) -> float:
    """Return when a message or one of its descendants last changed before a time.

    A change is a new state, or a handler that started to wait or returned.
    """
    below = [*run.under(message)] if isinstance(message, Task) else []
    handlings = [one for each in (message, *below) for one in each.handlings]
    times = [time for one in below for time, _ in one.states]
    times += [wait.start for one in handlings for wait in one.waits]
    times += [one.end for one in handlings if one.end is not None]
    return max((time for time in times if time < before), default=message.received)


class _Link(NamedTuple):
    """The node and the wait through which a walk came to a node."""

    before: Node | None
    wait: Wait | None
    is_elsewhere: bool
    """Whether the walk has left the descendants of the task."""


class _WaitWalk:
    """A walk from a task to all nodes for which it waits, directly or indirectly."""

    def __init__(self, at: RunAt, message: Message, until: float) -> None:
        self._at, self._until = at, until
        under = at.run.under(message) if isinstance(message, Task) else [message]
        self._own = {one.id for one in under}
        self._found: list[WaitCause] = []
        start = Node(message.id, END_ACHIEVING if isinstance(message, Task) else 0)
        self._links, self.nodes = {start: _Link(None, None, False)}, [start]
        for node in self.nodes:  # the list grows during the loop
            if (claim := at.run.claims.get(node.number)) is not None:
                self._at_claim(node, claim)
                continue
            for wait in blocking_waits(at, node):
                for other in prerequisites(at, wait):
                    self._visit(other, node, wait)
                self._check_leaf(node, wait)

    def first(self) -> WaitCause | None:
        """Return the most important cause; None if none is known."""
        return min(self._found, key=WaitCause.rank, default=None)

    def path_to(self, node: Node) -> list[str]:
        """Return the waits that lead to a node, in words."""
        words = list[str]()
        for before, wait in self._back_from(node):
            if wait is not None and wait.kind is not WaitKind.SUBTASK:
                who = "the handler of " * isinstance(wait.record, HandlerWait)
                who += self._at.describe(before.number)
                words.insert(0, f"{who} waits {in_words(wait_for(self._at, wait))}")
        return words

    def _back_from(self, node: Node) -> Iterator[tuple[Node, Wait | None]]:
        """Yield the nodes and waits through which the walk came to a node, back to the first."""
        while (link := self._links[node]).before is not None:
            yield link.before, link.wait
            node = link.before

    def _visit(self, node: Node, before: Node, wait: Wait | None) -> None:
        if node not in self._links:
            is_elsewhere = node.number not in self._own
            if wait is not None and wait.kind is WaitKind.REPLY:
                is_elsewhere = self._links[before].is_elsewhere
            self._links[node] = _Link(before, wait, is_elsewhere)
            self.nodes.append(node)

    def _at_claim(self, node: Node, claim: Claim) -> None:
        """Follow a lock to its holder's waits, or stop at a program that holds it."""
        others, _ = awaited_nodes(self._at, node)
        for other in others:
            self._visit(other, node, None)
        if others or not self._at.is_granted(claim) or (wait := self._handler_wait(node)) is None:
            return
        since = max(wait.start, claim.granted or 0.0)
        handling = wait.by if isinstance(wait.by, Handling) else None
        number = handling.message_id if handling else 0
        step = PathStep(since, self._until, Doing.LOCKED, number, claim.sender)
        self._add(node, number, handling if since == wait.start else None, step)

    def _handler_wait(self, node: Node) -> HandlerWait | None:
        """Return the last wait of a handler on the path to a node."""
        records = (wait.record for _, wait in self._back_from(node) if wait is not None)
        return next((one for one in records if isinstance(one, HandlerWait)), None)

    def _check_leaf(self, node: Node, wait: Wait) -> None:
        """Add a cause if a wait leads no further: a running handler or a standstill."""
        record, number, until = wait.record, node.number, self._until
        if wait.kind is WaitKind.RUNNING and isinstance(record, Handling):
            self._add(node, record.message_id, record)
        elif isinstance(record, Queueing):
            doing = Doing.QUEUED if record.module else Doing.NO_HANDLER
            step = PathStep(record.start, until, doing, number, record.module, record.resource)
            self._add(node, number, step=step)
        elif wait.kind is WaitKind.DELAY and isinstance(record, Hold):
            start, cause = delay_of(self._at.run, self._at.run.tasks[number], record)
            self._add(node, cause, step=PathStep(start, until, Doing.DELAY, number))
        elif isinstance(record, Suspension):
            self._suspended(node, wait, record)
        elif wait.kind is WaitKind.CONDITION:
            self._add(node, number, step=PathStep(wait.start, until, Doing.WATCHING, number))

    def _suspended(self, node: Node, wait: Wait, suspension: Suspension) -> None:
        """Add the standstill of a suspension, or visit the handlers that still run under it."""
        since, now = suspension.standstill, self._at.instant
        if since is None or now < since:
            begun = [one for one in suspension.handlings if one.start <= now]
            if running := [one for one in begun if now < one.until]:
                for handling in running:
                    self._visit(node_of(self._at.run, handling), node, wait)
                return
            # Nothing runs at present. A task that was resumed alone will run later.
            since = max([suspension.start, *(one.until for one in begun)])
        cause = suspension.cause
        self._add(node, cause, step=PathStep(since, self._until, Doing.SUSPENDED, cause))

    def _add(
        self,
        node: Node,
        message_id: int,
        handling: Handling | None = None,
        step: PathStep | None = None,
    ) -> None:
        is_elsewhere = self._links[node].is_elsewhere
        self._found.append(WaitCause(node, is_elsewhere, message_id, handling, step))
