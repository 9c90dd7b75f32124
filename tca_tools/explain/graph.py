"""The graph of waits at a moment: what keeps a task from one of its moments, and what that waits
for.

- ``keeping(at, node)``: what keeps a task from one of its moments, or a message from its answer.
What is planned ahead
  is kept from being planned by one thing and from being achieved by another: each wait says which
  moments it ``holds``.
- ``further(at, wait)``: the nodes that have to come about first; ``steps(at, node)`` does both.
- ``Ends``: what all waits lead to in the end; ``causes(at)``: what most tasks wait for.
- ``waits_now(at, number)``: what people are told of a message.

A wait in a queue (RESOURCE) or for a lock (LOCK) leads to what keeps the resource busy
(keepers.py).
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import islice
from math import inf
from operator import itemgetter
from typing import NamedTuple

from tca_tools.explain.keepers import Keepers, ahead_of_claim, kept_out, kept_since
from tca_tools.explain.overlapping import children_within
from tca_tools.explain.waits import (
    Node,
    Wait,
    begun_at,
    is_of_state,
    is_to_be_handled_again,
    kept_by,
    lasting,
    moments_before,
    next_moment,
    node_of,
    of_handler_wait,
    of_message,
    own_waits,
)
from tca_tools.journal.at_time import RunAt, remembered
from tca_tools.journal.fates import watches
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
    going_on,
    lately,
)
from tca_tools.journal.whole_run import Run
from tca_wire.points import END_ACHIEVING, END_HANDLING, END_PLANNING, START_HANDLING
from tca_wire.waits import NAMED, WaitKind
from tca_wire.waits import ends as walker

_KEPT = (WaitKind.RESOURCE, WaitKind.LOCK)
"""Waits for a resource that others keep busy."""

_SINCE = itemgetter(0)

_TOLD = 20
"""Things that many wait for."""
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
"""Why something waits for nothing else, in the order in which it is told: what stands first,
monitors that watch last. None: for something that the journal does not tell.
"""
_RANK = {kind: rank for rank, kind in enumerate(_RANKS)}


# --- what keeps a node from coming about ----------------------------------------------------------


class _Kept(NamedTuple):
    """The waits and nodes that keep a node from coming about."""

    waits: list[Wait]
    """Those for what is no subtask."""
    subtasks: list[Node]


_NOTHING = _Kept([], [])


@remembered
def _waits_of(at: RunAt, number: int) -> list[Wait]:
    """The waits of a message, whatever they keep it from, except for children."""
    message, time = at.run.messages[number], at.moment
    waits = list(of_message(at.run, message, time))
    if isinstance(message, Task):
        own = own_waits(at.run, message, time, time)
        waits[:0] = (one for one in own if one.start <= time < one.end)
    return waits


@remembered
def next_node(at: RunAt, number: int) -> Node:
    """The next node of a task, message or claim."""
    task = at.run.tasks.get(number)
    return Node(number) if task is None or task.received > at.moment else _next(task, at.moment)


def _next(task: Task, time: float) -> Node:
    state = task.state_at(time)
    runs = bool(going_on(task.handlings, time)) or watches(task, state, time)
    if runs and state is not TaskState.ENDING and task.time_of(END_HANDLING) > time:
        return Node(task.id, END_HANDLING)
    return Node(task.id, next_moment(task, state, time))


def keeping(at: RunAt, node: Node) -> list[Wait]:
    """The waits that keep a task from a moment, or a message from being answered."""
    kept = _kept(at, node)
    return kept.waits + [_subtask(at.run, one) for one in kept.subtasks]


def _subtask(run: Run, node: Node, others: Sequence[float] = ()) -> Wait:
    child, moment = run.tasks[node.number], node.moment
    end = min(child.time_of(moment), run.tasks[child.parent].time_of(moment))
    return Wait(child.received, end, WaitKind.SUBTASK, node, moment, others=others)


@remembered
def _kept(at: RunAt, node: Node) -> _Kept:
    """What keeps a node from coming about; nothing of a claim, and of what is unknown."""
    message = at.run.messages.get(node.number)
    if message is None or message.received > at.moment:
        return _NOTHING
    return _Kept(*_look(at.run, message, node, _waits_of(at, node.number), at.moment))


def _look(
    run: Run, message: Message, node: Node, waits: list[Wait], time: float
) -> tuple[list[Wait], list[Node]]:
    """Those of the waits that keep it from a node, and the subtasks that do."""
    if not isinstance(message, Task):
        return [one for one in waits if node.delivery in (0, _delivery(one))], []
    if not node.moment:
        return [one for one in waits if one.kind is WaitKind.RESUME], []
    wanted = moments_before(message, node.moment, time)
    found = [
        one for one in waits if one.holds & wanted or (wanted and _resumes(message, one, time))
    ]
    # what is achieved is planned
    last = wanted & END_ACHIEVING or wanted & END_PLANNING
    if not last:
        return found, []
    named = {one.on for one in found if one.kind in (WaitKind.SUBTASK, WaitKind.RECOVERY)}
    under = kept_by(run, children_within(run, message, last, time, time), last, time)
    open_ones = (one for one in under if one.received <= time < one.time_of(last))
    subtasks = (Node(one.id, last) for one in open_ones)
    return found, [one for one in subtasks if one not in named]


def _resumes(task: Task, wait: Wait, time: float) -> bool:
    """Whether it is for a task to be resumed that, as was decided meanwhile, is to be handled once
    more.
    """
    begun = wait.kind is WaitKind.RESUME and task.time_of(START_HANDLING) <= time
    return begun and is_to_be_handled_again(task, time)


def _delivery(wait: Wait) -> int:
    """Which delivery a run of a handler, or a wait of one, is."""
    run = wait.record.by if isinstance(wait.record, HandlerWait) else wait.record
    return run.delivery if isinstance(run, Handling) else 0


def further(at: RunAt, wait: Wait) -> list[Node]:
    """The nodes that must come about before a wait is over; empty for a leaf, or if they are not
    known.
    """
    number = wait.on.number
    if wait.is_leaf:
        return []
    if wait.kind is WaitKind.RESOURCE:
        return _nodes(at, keepers_of(at, wait))
    if wait.kind is WaitKind.TASK:
        task = at.run.tasks.get(number)
        is_to_come = task is not None and task.time_of(wait.on.moment) > at.moment
    elif wait.kind is WaitKind.CHANGE:
        is_to_come = number in at.tasks and at.tasks[number].state not in OVER
    elif wait.kind is WaitKind.REPLY:
        query = at.run.messages.get(number)
        is_to_come = query is not None and query.received <= at.moment
    else:
        return [wait.on]
    on = wait.on if wait.kind is WaitKind.TASK else next_node(at, number)
    return [on] if is_to_come else []


def keepers_of(at: RunAt, wait: Wait) -> Keepers:
    """The keepers of a resource from a queued message (RESOURCE) or a lock (LOCK)."""
    queueing, claim = wait.record, at.run.claims.get(wait.on.number)
    if isinstance(queueing, Queueing):
        message = at.run.messages.get(queueing.message_id)
        if message is not None:
            return kept_out(at, queueing.module, queueing.resource, message)
    elif claim is not None and not at.is_granted(claim):
        return ahead_of_claim(at, claim)
    return Keepers()


def _nodes(at: RunAt, by: Keepers) -> list[Node]:
    """A lock; or the runs of which the first that returns makes room: those that wait for nothing,
    if there are any.
    """
    if by.claim is not None:
        return [Node(by.claim.id)]
    free = [one for one in by.runs if not lately(one.waits, at.moment)]
    return [node_of(at.run, one) for one in free or by.runs]


@remembered
def steps(at: RunAt, node: Node) -> tuple[list[Node], list[WaitKind]]:
    """All that has to come about before a node does; and the kinds of its waits that are leaves."""
    kept = _kept(at, node)
    if kept is _NOTHING and (claim := at.run.claims.get(node.number)) is not None:
        return _of_claim(at, claim)
    nodes = [one for wait in kept.waits for one in further(at, wait)] + kept.subtasks
    return list(dict.fromkeys(nodes)), list(
        dict.fromkeys(wait.kind for wait in kept.waits if wait.is_leaf)
    )


def _of_claim(at: RunAt, claim: Claim) -> tuple[list[Node], list[WaitKind]]:
    """A lock that is wanted waits for all that is ahead of it. One in force waits for the handler,
    or else the task, for which it was wanted; of a retried one until that is handled again. Outside
    of handlers it waits for what its module waits for there.
    """
    if not at.is_granted(claim):
        by = ahead_of_claim(at, claim)
        nodes = [node_of(at.run, one) for one in by.runs]
        return nodes + [Node(one.id) for one in (by.claim,) if one is not None], []
    if claim.by is None:
        sender = at.run.modules.get(claim.sender)
        nodes = []
        for wait in lately(sender.waits, at.moment) if sender else ():
            nodes += further(at, of_handler_wait(at.run, wait))
        return nodes, [] if nodes else [WaitKind.LOCKED]
    task = at.tasks.get(claim.by.message_id)
    if claim.by.until > at.moment:
        return [node_of(at.run, claim.by)], []
    if task is not None and task.state not in OVER:
        return [Node(task.id, END_HANDLING if task.is_retried else END_ACHIEVING)], []
    return [], []


def held_above(at: RunAt, number: int) -> Iterator[tuple[int, Hold]]:
    """The constraints of tasks above that keep a task from what it comes to next, each with whose
    it is.
    """
    way = [next_node(at, number)]
    for node in way:  # grows while it is walked
        for wait in _kept(at, node).waits:
            if isinstance(wait.record, Hold) and node is not way[0]:
                yield node.number, wait.record
            way += [wait.on] * (wait.kind is WaitKind.PARENT)


# --- as people are told ---------------------------------------------------------------------------


def waits_now(at: RunAt, number: int) -> list[Wait]:
    """The waits of a message now. *start* is since when this is its cause: of a queued one, since
    when the same keeps the resource busy. The newest of many subtasks stands for all but the first
    ones.
    """
    kept = _kept(at, next_node(at, number))
    waits = list(kept.waits)
    waits += (_subtask(at.run, one) for one in kept.subtasks[:-1][:NAMED])
    if kept.subtasks:
        left = max(len(kept.subtasks) - NAMED - 1, 0)
        waits.append(_subtask(at.run, kept.subtasks[-1], (inf,) * left))
    task = at.run.tasks.get(number)
    if task is None:
        return [_told(at, wait) for wait in waits]
    place = task.place_at(at.moment)
    since, state = task.stage(place)
    if state is TaskState.SUSPENDED:
        waits = [*_still_running(at, task), *waits]
    told = []
    for wait in waits:
        if is_of_state(wait, state):
            start = max(wait.start, since)
            in_all = min(begun_at(task, place), start)
            told.append(wait._replace(start=start, since=in_all))
        else:
            told.append(_told(at, wait))
    return told


def _told(at: RunAt, wait: Wait) -> Wait:
    """A wait since its cause is the cause."""
    start = wait.start
    if wait.kind in _KEPT:
        kept = kept_since(at, keepers_of(at, wait), start)
        return wait._replace(start=kept, since=start)
    if wait.kind is WaitKind.CONDITION:
        start = max(start, _last_outcome(at, wait.on.number))
    return wait._replace(start=start, since=start)


def _last_outcome(at: RunAt, monitor: int) -> float:
    """Since when the condition of a monitor has held, or has not: the first of the tests in a row
    that found it so.
    """
    tests = at.run.tests.get(monitor, [])
    place = bisect_right(tests, at.moment, key=_SINCE)
    while place > 1 and tests[place - 2][1] == tests[place - 1][1]:
        place -= 1
    return tests[place - 1][0] if place > 1 else -inf  # before the first one nothing else was known


def _still_running(at: RunAt, task: Task) -> Iterator[Wait]:
    """The handlers under a suspended task that still work."""
    now = at.tasks[task.id]
    for run in at.ran_on(now):
        wait = lasting(run, WaitKind.RUNNING, node_of(at.run, run), 0)
        yield wait._replace(start=max(now.since, run.start))


# --- the ends of all waits ------------------------------------------------------------------------


class End(NamedTuple):
    """The end of a chain of waits: it waits for nothing else. Ends sort by what is told first."""

    rank: int
    """The place of its kind among ``_RANKS``."""
    number: int
    """The message, task or lock; of a circle the first one in it."""

    @property
    def kind(self) -> WaitKind | None:
        """Why it waits for nothing else (None: the journal does not tell)."""
        return _RANKS[self.rank]

    @property
    def goes_on(self) -> bool:
        """Whether it is no wait where it is the task's own: it runs, or watches."""
        return self.kind in (WaitKind.RUNNING, WaitKind.CONDITION)


class Cause(NamedTuple):
    """Something that tasks wait for in the end."""

    ends: tuple[End, ...]
    """It; several, of messages of one name that nobody handles."""
    tasks: int
    """How many wait for it."""
    first: int
    """The first task that does."""


class Ends:
    """The ends of all waits at a moment."""

    def __init__(self, at: RunAt) -> None:
        self._at = at
        self._walk: walker.Ends[Node, End] = walker.Ends(self)
        self._left: int | None = None
        """The number of waits that may be looked at (None: all)."""
        self._awaited: set[Node] = set()
        """All that something else waits for."""

    @classmethod
    def at(cls, at: RunAt) -> "Ends":
        """Those of a moment, as far as they have been looked for already."""
        found: Ends = at.memo.setdefault(cls, cls(at))
        return found

    def of(self, number: int, within: int | None = None) -> tuple[End, ...]:
        """The ends of a message's waits: the first ``MOST``, and one more if there are more.
        Itself, if it waits for nothing that has a number; nothing, if there are more than so many
        waits *within* which it was looked for.
        """
        return self.of_node(next_node(self._at, number), within)

    def of_node(self, node: Node, within: int | None = None) -> tuple[End, ...]:
        """The ends of the waits of any node."""
        self._left = within
        try:
            return self._walk.of(node)
        except walker.TooFarError:
            return ()

    def steps(self, node: Node) -> tuple[list[Node], list[End]]:
        """One step of the walk."""
        if self._left is not None:
            self._left -= 1
            if self._left < 0:
                raise walker.TooFarError
        nexts, leaves = steps(self._at, node)
        self._awaited.update(nexts)
        if nexts and not leaves:
            return nexts, []
        return nexts, [End(_RANK[kind], node.number) for kind in leaves or (None,)]

    @staticmethod
    def circle(nodes: list[Node]) -> End:
        """The end of those that wait for each other."""
        return End(_RANK[WaitKind.CIRCLE], min(node.number for node in nodes))

    def members(self, circle: End) -> list[int]:
        """All that wait for each other in a circle."""
        return sorted({node.number for node in self._walk.circles[circle]})

    def last(self) -> set[End]:
        """All ends that something else has been found to wait for."""
        known = (
            (to.number, self._walk.known[to][0]) for to in self._awaited if to in self._walk.known
        )
        return {end for number, end in known if end.number == number}


def causes(at: RunAt) -> tuple[int, int, list[Cause]]:
    """How many tasks wait, for how many things in the end, and the things that most of them wait
    for. What nobody handles counts once a name; a task counts for its first ``MOST`` ends.
    """
    ends = Ends.at(at)
    waiting: dict[int, tuple[tuple[End, ...], list[int]]] = {}
    for task in islice(at.run.tasks.values(), len(at.tasks)):
        if task.state_at(at.moment) not in OVER:
            found = ends.of(task.id)
            if found[0].number != task.id or not found[0].goes_on:
                if id(found) not in waiting:  # as they are all kept
                    waiting[id(found)] = found, []
                waiting[id(found)][1].append(task.id)
    first: dict[End, int] = {}
    things: dict[object, list[End]] = {}
    counts: Counter[object] = Counter()
    for found, tasks in waiting.values():
        first[found[0]] = min(tasks[0], first.get(found[0], tasks[0]))
        for thing, end in {_thing(at, end): end for end in reversed(found)}.items():
            things.setdefault(thing, []).append(end)
            counts[thing] += len(tasks)
    ranked = sorted(things, key=lambda thing: (-counts[thing], min(things[thing])))[:_TOLD]
    told = [tuple(sorted(set(things[thing]))) for thing in ranked]
    return (
        sum(len(tasks) for _, tasks in waiting.values()),
        len({*things, *(_thing(at, end) for end in ends.last())}),
        [
            Cause(one, counts[thing], first.get(one[0], one[0].number))
            for one, thing in zip(told, ranked, strict=True)
        ],
    )


def _thing(at: RunAt, end: End) -> object:
    return at.run.name(end.number) if end.kind is WaitKind.HANDLER else end
