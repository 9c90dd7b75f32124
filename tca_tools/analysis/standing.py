"""The cause that keeps an open task at a moment: a task that runs under it, or else one that it stands on.

A walk follows all that the task waits for, each thing once. What is under it counts first; where nothing there goes
on, its constraints, and its handlers that wait, lead to tasks elsewhere.
"""

from math import inf, nextafter
from typing import NamedTuple

from tca_tools.analysis.steps import Doing, PathStep, delay_of
from tca_tools.explain.ends import Ends
from tca_tools.explain.wait import Node, Wait, node_of
from tca_tools.explain.wait_words import wait_for
from tca_tools.explain.waits import further, keeping, steps, waits_now
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
        watches = self.standing is not None and self.standing.doing is Doing.WATCHING
        return watches, self.is_elsewhere, self.standing.start if self.standing else -inf


def going_on(at: RunAt, message: Message, until: float) -> GoingOn | None:
    """The cause of a wait *until* just after a moment: runs come before standstills, and these before monitors that
    watch; of standstills the longest. None if nothing is known.
    """
    return min(_WaitWalk(at, message, until).found, key=GoingOn.rank, default=None) or _circle(at, message, until)


def at_last(run: Run, task: Task) -> tuple[GoingOn, list[str]]:
    """The cause of an open task's wait when the journal ends; and if it is not under the task, the waits that lead
    there, in words. If it is not known, since when nothing happened under the task.
    """
    walk = _WaitWalk(RunAt(run), task, run.time)
    if (found := min(walk.found, key=GoingOn.rank, default=None)) is not None:
        return found, walk.way_to(found.node) if found.is_elsewhere else []
    if (found := _circle(RunAt(run), task, run.time)) is not None:
        return found, []
    last = last_change(run, task, inf)
    doing = Doing.HELD if waits_now(RunAt(run), task.id) and not task.handling else Doing.UNKNOWN
    step = PathStep(last, run.time, doing, task.id, "")
    return GoingOn(Node(task.id), False, task.id, None, step), []


def _circle(at: RunAt, message: Message, until: float) -> GoingOn | None:
    """The circle of waits that keeps something, since it was closed; None if there is none."""
    ends = Ends.at(at)
    found = next(iter(ends.of(message.id)), None)
    if found is None or found.kind is not WaitKind.CIRCLE:
        return None
    members = [at.run.messages[one] for one in ends.members(found) if one in at.run.messages]
    closed, member = max((last_change(at.run, one, nextafter(at.moment, inf)), one.id) for one in members)
    step = PathStep(closed, until, Doing.CIRCLE, member, "")
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
        self._own = {one.id for one in at.run.under(message)} if isinstance(message, Task) else {message.id}
        self.found: list[GoingOn] = []
        self._ways: dict[Node, _Way] = {}
        self._nodes: list[Node] = []
        self._come_to(Node(message.id, END_ACHIEVING if isinstance(message, Task) else 0), None, None)
        for node in self._nodes:  # grows while it is walked
            if (claim := at.run.claims.get(node.number)) is not None:
                self._at_claim(node, claim)
                continue
            for wait in keeping(at, node):
                for other in further(at, wait):
                    self._come_to(other, node, wait)
                self._end(node, wait)

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

    def _come_to(self, node: Node, before: Node | None, wait: Wait | None) -> None:
        if node not in self._ways:
            is_reply = wait is not None and wait.kind is WaitKind.REPLY
            came_elsewhere = before is not None and self._ways[before].is_elsewhere
            is_elsewhere = came_elsewhere if is_reply else node.number not in self._own
            self._ways[node] = _Way(before, wait, is_elsewhere)
            self._nodes.append(node)

    def _at_claim(self, node: Node, claim: Claim) -> None:
        """Follow a lock to all that its holder waits for; or to the program that has it, outside of handlers."""
        others, _ = steps(self._at, node)
        for other in others:
            self._come_to(other, node, None)
        way = self._ways[node]
        while way.before is not None and not (way.wait and isinstance(way.wait.record, HandlerWait)):
            way = self._ways[way.before]
        wait = way.wait.record if way.wait else None
        if others or not self._at.is_granted(claim) or not isinstance(wait, HandlerWait):
            return
        since, handling = max(wait.start, claim.granted or 0.0), wait.by if isinstance(wait.by, Handling) else None
        number = handling.message_id if handling else 0
        self._stands(
            node, number, number, since, Doing.LOCKED, claim.sender, by=handling if since == wait.start else None
        )

    def _end(self, node: Node, wait: Wait) -> None:
        """Note what waits for nothing else: it runs, or stands."""
        record, number = wait.record, node.number
        if wait.kind is WaitKind.RUNNING and isinstance(record, Handling):
            elsewhere = self._ways[node].is_elsewhere
            self.found.append(GoingOn(node, elsewhere, record.message_id, record, None))
        elif isinstance(record, Queueing):
            doing = Doing.QUEUED if record.module else Doing.NO_HANDLER
            self._stands(node, number, number, record.start, doing, record.module, record.resource)
        elif wait.kind is WaitKind.DELAY and isinstance(record, Hold):
            start, cause = delay_of(self._at.run, self._at.run.tasks[number], record)
            self._stands(node, number, cause, start, Doing.DELAY)
        elif isinstance(record, Suspension):
            since = record.standstill
            if stands := since is not None and since <= self._at.moment:
                self._stands(node, record.cause, record.cause, since, Doing.SUSPENDED)
            for run in () if stands else record.still:
                if run.start <= self._at.moment < run.until:
                    self._come_to(node_of(self._at.run, run), node, wait)
        elif wait.kind is WaitKind.CONDITION:
            self._stands(node, number, number, wait.start, Doing.WATCHING)

    def _stands(
        self, node: Node, number: int, cause: int, since: float, doing: Doing, module: str = "", resource: str = "",
        by: Handling | None = None,
    ) -> None:  # fmt: skip
        step = PathStep(since, self._until, doing, number, module, resource)
        self.found.append(GoingOn(node, self._ways[node].is_elsewhere, cause, by, step))
