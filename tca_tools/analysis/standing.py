"""The cause that keeps an open task at a moment: a task that runs under it, or else one that it stands on.

A walk follows all that the task waits for, each thing once. What is under it counts first; where nothing there goes
on, its constraints, and its handlers that wait, lead to tasks elsewhere.
"""

from math import inf, nextafter
from typing import NamedTuple

from tca_tools.analysis.steps import Doing, PathStep, delay_of
from tca_tools.explain.ends import Ends
from tca_tools.explain.graph import further, keeping, steps, waits_now
from tca_tools.explain.wait_words import wait_for
from tca_tools.explain.waits import Node, Wait, node_of
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import Claim, HandlerWait, Handling, Hold, Message, Queueing, Suspension, Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import END_ACHIEVING
from tca_wire.text.waits_in_words import in_words
from tca_wire.waits import WaitKind


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
    """The cause of a wait *until* just after a moment: runs come before standstills, and these before monitors that
    watch; of standstills the longest. None if nothing is known.
    """
    return _WaitWalk(at, message, until).first() or _circle(at, message, until)


def at_last(run: Run, task: Task) -> tuple[GoingOn, list[str]]:
    """The cause of an open task's wait when the journal ends; and if it is not under the task, the waits that lead
    there, in words. If it is not known, since when nothing happened under the task.
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
    """When something last happened to a message or to what is under it: a new state, or a handler waits or is done."""
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
        words, way = list[str](), self._ways[node]
        while way.before is not None:
            if way.wait is not None and way.wait.kind is not WaitKind.SUBTASK:
                who = "the handler of " * isinstance(way.wait.record, HandlerWait)
                who += self._at.describe(way.before.number)
                words.insert(0, f"{who} waits {in_words(wait_for(self._at, way.wait))}")
            way = self._ways[way.before]
        return words

    def _come_to(self, node: Node, before: Node, wait: Wait | None) -> None:
        if node not in self._ways:
            is_elsewhere = node.number not in self._own
            if wait is not None and wait.kind is WaitKind.REPLY:
                is_elsewhere = self._ways[before].is_elsewhere
            self._ways[node] = _Way(before, wait, is_elsewhere)
            self._nodes.append(node)

    def _at_claim(self, node: Node, claim: Claim) -> None:
        """Follow a lock to all that its holder waits for; or to the program that has it, outside of handlers."""
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
        way = self._ways[node]
        while way.before is not None:
            if way.wait is not None and isinstance(way.wait.record, HandlerWait):
                return way.wait.record
            way = self._ways[way.before]
        return None

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
        self, node: Node, message_id: int, handling: Handling | None = None, step: PathStep | None = None
    ) -> None:  # fmt: skip
        is_elsewhere = self._ways[node].is_elsewhere
        self._found.append(GoingOn(node, is_elsewhere, message_id, handling, step))
