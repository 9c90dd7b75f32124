"""What keeps a task at a moment, when the journal ends or it is cut off: what runs under it, or else what it stands on.

A walk follows all that the task waits for, each thing once. What is under it counts first; where nothing there goes
on, its constraints, and its handlers that wait, lead to tasks elsewhere.
"""

from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from tca_tools.analysis.steps import Doing, Step, delay_of
from tca_tools.run.at_time import RunAt
from tca_tools.run.records import Claim, HandlerWait, Handling, Hold, Message, Queueing, Suspension, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.wait_words import wait_for
from tca_tools.why.waits import Node, Wait, further, keeping, steps, waits_now
from tca_wire.points import END_ACHIEVING
from tca_wire.text.waits_in_words import in_words
from tca_wire.waits import WaitKind


@dataclass(slots=True)
class GoingOn:
    """What a task waits for at a moment."""

    time: float
    """Until when something went on: that moment, or when it came to stand."""
    message_id: int
    handling: Handling | None = None
    """The handler that went on until then."""
    standing: Step | None = None
    """If nothing does: what stands since then."""
    because: list[str] = field(default_factory=list)
    """If it is not under the task: the waits that lead there, in words."""


def going_on(at: RunAt, message: Message, until: float) -> GoingOn | None:
    """What a task or message waited for *until* just after a moment: what runs comes before what stands, and that
    before monitors that watch; of what stands that which has stood longest. None if nothing is known.
    """
    walk = _Walk(at, message, until)
    found = min(walk.found, key=_Found.rank, default=None)
    if found is None:
        return None
    step = found.stands
    because = walk.way_to(found.node) if found.is_elsewhere else []
    if step is None:
        return GoingOn(until, found.cause, found.handling, None, because)
    return GoingOn(step.start, found.cause, found.handling, step if step.seconds > 0 else None, because)


def at_last(run: Run, task: Task) -> GoingOn:
    """What an open task waits for when the journal ends; if that is not known, since when nothing happened under it."""
    if (found := going_on(RunAt(run), task, run.time)) is not None:
        return found
    last = last_change(run, task, inf)
    is_held = waits_now(RunAt(run), task.id) and not task.handling  # else its handler stands in a circle of waits
    doing = Doing.HELD if is_held else Doing.UNKNOWN
    step = Step(last, run.time, doing, task.id, "") if run.time > last else None
    return GoingOn(last, task.id, standing=step)


def last_change(run: Run, message: Message, before: float) -> float:
    """When something last happened to a task or to what is under it, or when a message was handled last."""
    if isinstance(message, Task):
        times = [time for one in run.under(message) for time, _ in one.states]
    else:
        times = [handling.end for handling in message.handlings if handling.end is not None]
    return max((time for time in times if time < before), default=message.received)


class _Way(NamedTuple):
    """How a walk came to a node."""

    before: Node | None
    wait: Wait | None
    is_elsewhere: bool
    """Whether that is not under the task from which the walk began."""


class _Found(NamedTuple):
    """Something at which a walk may end."""

    node: Node
    is_elsewhere: bool
    stands: Step | None
    """None: it runs."""
    cause: int
    """The message at whose event it came to that."""
    handling: Handling | None = None

    def rank(self) -> tuple[bool, bool, float]:
        """What counts first has the least."""
        watches = self.stands is not None and self.stands.doing is Doing.WATCHING
        return watches, self.is_elsewhere, self.stands.start if self.stands else -inf


class _Walk:
    """From a task to all that it waits for, and what that waits for."""

    def __init__(self, at: RunAt, message: Message, until: float) -> None:
        self._at, self._until = at, until
        self._own = {one.id for one in at.run.under(message)} if isinstance(message, Task) else {message.id}
        self.found: list[_Found] = []
        self._ways: dict[Node, _Way] = {}
        self._nodes: list[Node] = []
        self._come_to(Node(message.id, END_ACHIEVING if isinstance(message, Task) else 0), None, None)
        for node in self._nodes:  # grows while it is walked
            if (claim := at.run.claims.get(node.number)) is not None:
                self._at_claim(node, claim)
            else:
                self._at_message(node)

    def way_to(self, node: Node) -> list[str]:
        """The waits that lead to a node, in words."""
        words = []
        way: _Way | None = self._ways[node]
        while way is not None and way.before is not None:
            if way.wait is not None and way.wait.kind is not WaitKind.SUBTASK:
                who = self._at.describe(way.before.number)
                who = f"the handler of {who}" if isinstance(way.wait.record, HandlerWait) else who
                words.append(f"{who} waits {in_words(wait_for(self._at, way.wait))}")
            way = self._ways[way.before]
        return words[::-1]

    def _come_to(self, node: Node, before: Node | None, wait: Wait | None) -> None:
        if node not in self._ways:
            is_reply = wait is not None and wait.kind is WaitKind.REPLY
            came_elsewhere = before is not None and self._ways[before].is_elsewhere
            is_elsewhere = came_elsewhere if is_reply else node.number not in self._own
            self._ways[node] = _Way(before, wait, is_elsewhere)
            self._nodes.append(node)

    def _at_message(self, node: Node) -> None:
        for wait in keeping(self._at, node):
            for other in further(self._at, wait):
                self._come_to(other, node, wait)
            if (found := self._end(node, wait)) is not None:
                self.found.append(found)

    def _at_claim(self, node: Node, claim: Claim) -> None:
        """Who waits for a lock waits for all that its holder waits for; or a program has it, outside of handlers."""
        others, _ = steps(self._at, node)
        for other in others:
            self._come_to(other, node, None)
        way: _Way = self._ways[node]
        while way.before is not None and not (way.wait and isinstance(way.wait.record, HandlerWait)):
            way = self._ways[way.before]
        wait = way.wait.record if way.wait else None
        if others or not self._at.is_granted(claim) or not isinstance(wait, HandlerWait):
            return
        since, by = max(wait.start, claim.granted or 0.0), wait.by
        number = by.message_id if isinstance(by, Handling) else 0
        step = Step(since, self._until, Doing.LOCKED, number, claim.sender)
        handling = by if isinstance(by, Handling) and since == wait.start else None
        self.found.append(_Found(node, self._ways[node].is_elsewhere, step, number, handling))

    def _end(self, node: Node, wait: Wait) -> _Found | None:
        run, record, elsewhere = self._at.run, wait.record, self._ways[node].is_elsewhere
        if wait.kind is WaitKind.RUNNING and isinstance(record, Handling):
            return _Found(node, elsewhere, None, record.message_id, record)
        if isinstance(record, Queueing):
            doing = Doing.QUEUED if record.module else Doing.NO_HANDLER
            step = Step(record.start, self._until, doing, node.number, record.module, record.resource)
            return _Found(node, elsewhere, step, node.number)
        if wait.kind is WaitKind.DELAY and isinstance(record, Hold):
            start, cause = delay_of(run, run.tasks[node.number], record)
            return _Found(node, elsewhere, Step(start, self._until, Doing.DELAY, node.number, ""), cause)
        if isinstance(record, Suspension) and (since := record.standstill) is not None and since < self._until:
            return _Found(node, elsewhere, Step(since, self._until, Doing.SUSPENDED, record.cause, ""), record.cause)
        if wait.kind is WaitKind.CONDITION:
            return _Found(node, elsewhere, Step(wait.start, self._until, Doing.WATCHING, node.number, ""), node.number)
        return None
