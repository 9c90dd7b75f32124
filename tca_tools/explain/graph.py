"""The graph of waits at an instant.

- ``blocking_waits(at, node)``: the waits before a moment of a task, or before a message's answer.
  A wait may block planning and not achieving, so it says which moments it ``blocks``.
- ``prerequisites(at, wait)``: the nodes that a wait is for. ``awaited_nodes(at, node)``: the
  prerequisites of all waits that block a node.
- ``Ends``: the ends of all chains of waits; ``causes(at)``: the ends that most tasks wait for.
- ``waits_now(at, number)``: the current waits of a message, to be shown.

A wait in a queue (RESOURCE) or for a lock (LOCK) leads to the holders of the resource (holders.py).
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import islice
from math import inf
from operator import itemgetter
from typing import NamedTuple

from tca_tools.explain.holders import Holders, held_since, holders_for_claim, holders_for_message
from tca_tools.explain.overlapping import children_within
from tca_tools.explain.waits import (
    Node,
    Wait,
    begun_at,
    blocking_tasks,
    is_of_state,
    is_to_be_handled_again,
    moments_before,
    next_moment,
    node_of,
    of_handler_wait,
    of_message,
    own_waits,
    span_as_wait,
)
from tca_tools.journal.at_time import RunAt, remembered
from tca_tools.journal.fates import is_watching
from tca_tools.journal.records import (
    OVER,
    Claim,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Queueing,
    Task,
    TaskState,
)
from tca_tools.journal.sequences import active_at, newest_active
from tca_tools.journal.whole_run import Run
from tca_wire.points import END_ACHIEVING, END_HANDLING, END_PLANNING, START_HANDLING
from tca_wire.waits import NAMED, WaitKind
from tca_wire.waits import ends as walker

_HELD = (WaitKind.RESOURCE, WaitKind.LOCK)
"""Waits for a resource with holders."""

_SINCE = itemgetter(0)

_MOST_CAUSES = 20
"""The number of causes that ``causes`` returns."""
_RANKS = (
    WaitKind.CIRCLE,
    WaitKind.HANDLER,
    WaitKind.RESUME,
    WaitKind.LOCKED,
    None,
    WaitKind.DELAY,
    WaitKind.PRESENCE,
    WaitKind.CHANGE,
    WaitKind.RUNNING,
    WaitKind.CONDITION,
)
"""The kinds of ends of waits, in the order in which they are shown: standstills first, watching
monitors last. None: the journal does not contain the cause.
"""
_RANK = {kind: rank for rank, kind in enumerate(_RANKS)}


# --- what blocks a node ---------------------------------------------------------------------------


class _Blocking(NamedTuple):
    """The waits and nodes that block a node."""

    waits: list[Wait]
    """The waits, without those for subtasks."""
    subtasks: list[Node]


_NOTHING = _Blocking([], [])


@remembered
def _waits_of(at: RunAt, number: int) -> list[Wait]:
    """Return all waits of a message at the instant, except for those for its subtasks."""
    message, time = at.run.messages[number], at.instant
    waits = list(of_message(at.run, message, time))
    if isinstance(message, Task):
        own = own_waits(at.run, message, time, time)
        waits[:0] = (one for one in own if one.start <= time < one.end)
    return waits


@remembered
def next_node(at: RunAt, number: int) -> Node:
    """Return the node that a task, message or claim must reach next."""
    task = at.run.tasks.get(number)
    return (
        Node(number)
        if task is None or task.received > at.instant
        else _next_of_task(task, at.instant)
    )


def _next_of_task(task: Task, time: float) -> Node:
    state = task.state_at(time)
    is_running = bool(active_at(task.handlings, time)) or is_watching(task, state, time)
    if is_running and state is not TaskState.ENDING and task.time_of(END_HANDLING) > time:
        return Node(task.id, END_HANDLING)
    return Node(task.id, next_moment(task, state, time))


def blocking_waits(at: RunAt, node: Node) -> list[Wait]:
    """Return the waits that block a moment of a task, or the answer to a message."""
    blocking = _blocking(at, node)
    return blocking.waits + [_wait_for_subtask(at.run, one) for one in blocking.subtasks]


def _wait_for_subtask(run: Run, node: Node, others: Sequence[float] = ()) -> Wait:
    child, moment = run.tasks[node.number], node.moment
    end = min(child.time_of(moment), run.tasks[child.parent].time_of(moment))
    return Wait(child.received, end, WaitKind.SUBTASK, node, moment, others=others)


@remembered
def _blocking(at: RunAt, node: Node) -> _Blocking:
    """Return what blocks a node; nothing for a claim, and for an unknown message."""
    message = at.run.messages.get(node.number)
    if message is None or message.received > at.instant:
        return _NOTHING
    return _Blocking(
        *_select_blocking(at.run, message, node, _waits_of(at, node.number), at.instant)
    )


def _select_blocking(
    run: Run, message: Message, node: Node, waits: list[Wait], time: float
) -> tuple[list[Wait], list[Node]]:
    """Return the waits that block a node of a message, and the subtasks that do."""
    if not isinstance(message, Task):
        return [one for one in waits if node.delivery in (0, _delivery(one))], []
    if not node.moment:
        return [one for one in waits if one.kind is WaitKind.RESUME], []
    wanted = moments_before(message, node.moment, time)
    found = [
        one for one in waits if one.blocks & wanted or (wanted and _resumes(message, one, time))
    ]
    # A task must be planned before it is achieved
    last = wanted & END_ACHIEVING or wanted & END_PLANNING
    if not last:
        return found, []
    named = {one.on for one in found if one.kind in (WaitKind.SUBTASK, WaitKind.RECOVERY)}
    under = blocking_tasks(run, children_within(run, message, last, time, time), last, time)
    open_ones = (one for one in under if one.received <= time < one.time_of(last))
    subtasks = (Node(one.id, last) for one in open_ones)
    return found, [one for one in subtasks if one not in named]


def _resumes(task: Task, wait: Wait, time: float) -> bool:
    """Whether a wait is for the resume of a task that has started and is to be handled again."""
    begun = wait.kind is WaitKind.RESUME and task.time_of(START_HANDLING) <= time
    return begun and is_to_be_handled_again(task, time)


def _delivery(wait: Wait) -> int:
    """Return the delivery of the handler that waits, or that is awaited; 0 if there is none."""
    record = wait.record.by if isinstance(wait.record, HandlerWait) else wait.record
    return record.delivery if isinstance(record, Handling) else 0


def prerequisites(at: RunAt, wait: Wait) -> list[Node]:
    """Return the nodes that a wait is for; empty for a leaf, or if they are unknown."""
    number = wait.on.number
    if wait.is_leaf:
        return []
    if wait.kind is WaitKind.RESOURCE:
        return _nodes_of_holders(at, holders_of(at, wait))
    if wait.kind is WaitKind.TASK:
        task = at.run.tasks.get(number)
        is_pending = task is not None and task.time_of(wait.on.moment) > at.instant
    elif wait.kind is WaitKind.CHANGE:
        is_pending = number in at.tasks and at.tasks[number].state not in OVER
    elif wait.kind is WaitKind.REPLY:
        query = at.run.messages.get(number)
        is_pending = query is not None and query.received <= at.instant
    else:
        return [wait.on]
    on = wait.on if wait.kind is WaitKind.TASK else next_node(at, number)
    return [on] if is_pending else []


def holders_of(at: RunAt, wait: Wait) -> Holders:
    """Return the holders of the resource for which a message (RESOURCE) or lock (LOCK) waits."""
    queueing, claim = wait.record, at.run.claims.get(wait.on.number)
    if isinstance(queueing, Queueing):
        message = at.run.messages.get(queueing.message_id)
        if message is not None:
            return holders_for_message(at, queueing.module, queueing.resource, message)
    elif claim is not None and not at.is_granted(claim):
        return holders_for_claim(at, claim)
    return Holders()


def _nodes_of_holders(at: RunAt, by: Holders) -> list[Node]:
    """Return the nodes of holders: a lock, else the handlers that do not wait, else all handlers.

    The first handler that returns frees a slot.
    """
    if by.claim is not None:
        return [Node(by.claim.id)]
    free = [one for one in by.handlings if not newest_active(one.waits, at.instant)]
    return [node_of(at.run, one) for one in free or by.handlings]


@remembered
def awaited_nodes(at: RunAt, node: Node) -> tuple[list[Node], list[WaitKind]]:
    """Return the nodes for which a node waits, and the kinds of its waits that are for no node."""
    blocking = _blocking(at, node)
    if blocking is _NOTHING and (claim := at.run.claims.get(node.number)) is not None:
        return _of_claim(at, claim)
    nodes = [one for wait in blocking.waits for one in prerequisites(at, wait)]
    nodes += blocking.subtasks
    leaves = dict.fromkeys(wait.kind for wait in blocking.waits if wait.is_leaf)
    return list(dict.fromkeys(nodes)), list(leaves)


def _of_claim(at: RunAt, claim: Claim) -> tuple[list[Node], list[WaitKind]]:
    """Return the nodes for which a lock waits, and the kinds of its waits that are for no node.

    A pending lock waits for the holders of its resource. A lock in force waits for the handler that
    requested it. If that handler has returned, the lock waits for the end of the handler's task,
    or for the next handling if a retry is due. A lock requested outside of handlers waits for the
    same nodes as its module does outside of handlers.
    """
    if not at.is_granted(claim):
        by = holders_for_claim(at, claim)
        nodes = [node_of(at.run, one) for one in by.handlings]
        return nodes + [Node(one.id) for one in (by.claim,) if one is not None], []
    if claim.by is None:
        sender = at.run.modules.get(claim.sender)
        nodes = []
        for wait in newest_active(sender.waits, at.instant) if sender else ():
            nodes += prerequisites(at, of_handler_wait(at.run, wait))
        return nodes, [] if nodes else [WaitKind.LOCKED]
    task = at.tasks.get(claim.by.message_id)
    if claim.by.until > at.instant:
        return [node_of(at.run, claim.by)], []
    if task is not None and task.state not in OVER:
        return [Node(task.id, END_HANDLING if task.is_retry_due else END_ACHIEVING)], []
    return [], []


def held_above(at: RunAt, number: int) -> Iterator[tuple[int, Hold]]:
    """Yield the constraints on ancestors that block a task's next node, each with the ancestor."""
    path = [next_node(at, number)]
    for node in path:  # the list grows during the loop
        for wait in _blocking(at, node).waits:
            if isinstance(wait.record, Hold) and node is not path[0]:
                yield node.number, wait.record
            path += [wait.on] * (wait.kind is WaitKind.PARENT)


# --- waits for display ----------------------------------------------------------------------------


def waits_now(at: RunAt, number: int) -> list[Wait]:
    """Return the current waits of a message, with the start of their current causes.

    A wait in a queue starts when the current holders got the resource. Of the subtasks, only the
    first ones and the newest are listed. The wait for the newest stands for those left out.
    """
    blocking = _blocking(at, next_node(at, number))
    waits = list(blocking.waits)
    waits += (_wait_for_subtask(at.run, one) for one in blocking.subtasks[:-1][:NAMED])
    if blocking.subtasks:
        left = max(len(blocking.subtasks) - NAMED - 1, 0)
        waits.append(_wait_for_subtask(at.run, blocking.subtasks[-1], (inf,) * left))
    task = at.run.tasks.get(number)
    if task is None:
        return [_since_cause(at, wait) for wait in waits]
    place = task.place_at(at.instant)
    since, state = task.stage(place)
    if state is TaskState.SUSPENDED:
        waits = [*_still_running(at, task), *waits]
    shown = []
    for wait in waits:
        if is_of_state(wait, state):
            start = max(wait.start, since)
            in_all = min(begun_at(task, place), start)
            shown.append(wait._replace(start=start, since=in_all))
        else:
            shown.append(_since_cause(at, wait))
    return shown


def _since_cause(at: RunAt, wait: Wait) -> Wait:
    """Return a wait with the start of its current cause."""
    start = wait.start
    if wait.kind in _HELD:
        held = held_since(at, holders_of(at, wait), start)
        return wait._replace(start=held, since=start)
    if wait.kind is WaitKind.CONDITION:
        start = max(start, _last_outcome(at, wait.on.number))
    return wait._replace(start=start, since=start)


def _last_outcome(at: RunAt, monitor: int) -> float:
    """Return the time since which all tests of a monitor's condition had the same outcome."""
    tests = at.run.tests.get(monitor, [])
    place = bisect_right(tests, at.instant, key=_SINCE)
    while place > 1 and tests[place - 2][1] == tests[place - 1][1]:
        place -= 1
    return tests[place - 1][0] if place > 1 else -inf  # one test does not show a change


def _still_running(at: RunAt, task: Task) -> Iterator[Wait]:
    """Yield waits for the handlers that still work under a suspended task."""
    now = at.tasks[task.id]
    for handling in at.working_under(now):
        wait = span_as_wait(handling, WaitKind.RUNNING, node_of(at.run, handling), 0)
        yield wait._replace(start=max(now.since, handling.start))


# --- the ends of all waits ------------------------------------------------------------------------


class End(NamedTuple):
    """The end of a chain of waits: a node that does not wait. Ends sort by display order."""

    rank: int
    """The index of its kind in ``_RANKS``."""
    number: int
    """The message, task or lock; for a cycle, its member with the smallest number."""

    @property
    def kind(self) -> WaitKind | None:
        """The kind of the end (None: the journal does not contain the cause)."""
        return _RANKS[self.rank]

    @property
    def is_active(self) -> bool:
        """Whether the node runs or watches, so that it does not wait."""
        return self.kind in (WaitKind.RUNNING, WaitKind.CONDITION)


class Cause(NamedTuple):
    """A cause at the end of the waits of some tasks."""

    ends: tuple[End, ...]
    """The ends: one, or several for unhandled messages of one name."""
    tasks: int
    """The number of tasks that wait for it."""
    first: int
    """The first task that waits for it."""


class Ends:
    """The ends of all waits at an instant."""

    def __init__(self, at: RunAt) -> None:
        self._at = at
        self._walk: walker.Ends[Node, End] = walker.Ends(self)
        self._left: int | None = None
        """The number of steps that the walk may still take; None for any number."""
        self._awaited: set[Node] = set()
        """The nodes that others wait for."""

    @classmethod
    def at(cls, at: RunAt) -> "Ends":
        """Return the ends at an instant; ends already found are cached."""
        found: Ends = at.memo.setdefault(cls, cls(at))
        return found

    def of(self, number: int, within: int | None = None) -> tuple[End, ...]:
        """Return the ends of a message's waits: the first ``MOST``, and one more if there are more.

        The message is its own end if it does not wait for another node.

        Args:
            number: The message.
            within: The most steps to take; if they are not enough, no ends are returned.
        """
        return self.of_node(next_node(self._at, number), within)

    def of_node(self, node: Node, within: int | None = None) -> tuple[End, ...]:
        """Return the ends of a node's waits."""
        self._left = within
        try:
            return self._walk.of(node)
        except walker.TooFarError:
            return ()

    def steps(self, node: Node) -> tuple[list[Node], list[End]]:
        """Take one step of the walk; called by the walker."""
        if self._left is not None:
            self._left -= 1
            if self._left < 0:
                raise walker.TooFarError
        nexts, leaves = awaited_nodes(self._at, node)
        self._awaited.update(nexts)
        if nexts and not leaves:
            return nexts, []
        return nexts, [End(_RANK[kind], node.number) for kind in leaves or (None,)]

    @staticmethod
    def circle(nodes: list[Node]) -> End:
        """Return the end that stands for a cycle of waits."""
        return End(_RANK[WaitKind.CIRCLE], min(node.number for node in nodes))

    def members(self, circle: End) -> list[int]:
        """Return the members of a cycle."""
        return sorted({node.number for node in self._walk.circles[circle]})

    def last(self) -> set[End]:
        """Return all ends found so far that another node waits for."""
        known = (
            (to.number, self._walk.known[to][0]) for to in self._awaited if to in self._walk.known
        )
        return {end for number, end in known if end.number == number}


def causes(at: RunAt) -> tuple[int, int, list[Cause]]:
    """Return the number of waiting tasks, the number of causes, and the most important causes.

    Unhandled messages of one name count as one cause; a task counts for its first ``MOST`` ends.
    """
    ends = Ends.at(at)
    waiting: dict[int, tuple[tuple[End, ...], list[int]]] = {}
    for task in islice(at.run.tasks.values(), len(at.tasks)):
        if task.state_at(at.instant) not in OVER:
            found = ends.of(task.id)
            if found[0].number != task.id or not found[0].is_active:
                # Cached tuples have stable identities
                if id(found) not in waiting:
                    waiting[id(found)] = found, []
                waiting[id(found)][1].append(task.id)
    first: dict[End, int] = {}
    by_key: dict[object, list[End]] = {}
    counts: Counter[object] = Counter()
    for found, tasks in waiting.values():
        first[found[0]] = min(tasks[0], first.get(found[0], tasks[0]))
        for key, end in {_cause_key(at, end): end for end in reversed(found)}.items():
            by_key.setdefault(key, []).append(end)
            counts[key] += len(tasks)
    ranked = sorted(by_key, key=lambda key: (-counts[key], min(by_key[key])))[:_MOST_CAUSES]
    shown = [tuple(sorted(set(by_key[key]))) for key in ranked]
    return (
        sum(len(tasks) for _, tasks in waiting.values()),
        len({*by_key, *(_cause_key(at, end) for end in ends.last())}),
        [
            Cause(one, counts[key], first.get(one[0], one[0].number))
            for one, key in zip(shown, ranked, strict=True)
        ],
    )


def _cause_key(at: RunAt, end: End) -> object:
    return at.run.name(end.number) if end.kind is WaitKind.HANDLER else end
