"""Why something waits: for each task and message one list of waits, read off its records.

How to use it:

- ``waits_of(run, number)``: all that a task or message ever waited for, oldest first. Each wait has one cause, from
  when until when it was one; several may overlap. A task that was held by three constraints has three waits, each of
  which ends when its own is met. So the list is linear in the journal, and nothing has to be cut.
- ``told_waits(run, task)``: the same as people are told of it: what kept a task from what came next in each of its
  states, cut to the span of that state; ``since`` is since when it had waited in all.
- ``waits_now(at, number)``: what something waits for at a moment, told likewise.
- ``keeping(at, node)``: what keeps a task from one of its moments, or a message from its answer, at a moment of the
  run. What is planned ahead is kept from being planned by one thing and from being achieved by another, so each wait
  says which moments it ``holds``.
- ``further(at, wait)``: the nodes that have to come about first; ``steps(at, node)`` does both. So walks go from node
  to node (ends.py).

A wait in a queue (RESOURCE) or for a lock (LOCK) leads to whatever keeps the resource busy: keepers.py has that at a
moment, and over time. What has no further nodes is a leaf: HANDLER, DELAY, CONDITION, RUNNING, and RESUME of what was
itself suspended. Words come last: wait_words.py.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import reduce
from itertools import chain
from math import inf
from operator import attrgetter, itemgetter, or_
from typing import Any, NamedTuple, TypeVar

from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import watching
from tca_tools.run.records import OVER, Claim, HandlerWait, Handling, Hold, Message, Queueing, State, Suspension, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.keepers import Keepers, ahead_of_claim, kept_out, kept_since
from tca_wire.points import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
)
from tca_wire.waits import WaitKind

NO_TIME = 1e-6
"""Seconds: what lasts no longer is no wait to tell of."""
_BEFORE = {
    is_goal: {
        0: (),
        START_HANDLING: (START_HANDLING, first),
        START_PLANNING: (START_HANDLING, first),
        END_HANDLING: (START_HANDLING, first, END_HANDLING),
        END_PLANNING: (START_HANDLING, first, END_HANDLING, END_PLANNING),
        START_ACHIEVING: (START_HANDLING, first, START_ACHIEVING),
        END_ACHIEVING: (START_HANDLING, first, END_HANDLING, planned, START_ACHIEVING, END_ACHIEVING),
    }
    for is_goal, first, planned in ((True, START_PLANNING, END_PLANNING), (False, START_ACHIEVING, END_HANDLING))
}
"""All that comes no later than a moment, and the moment: of a goal (True), and of what only acts."""
_NEXT = {
    State.HELD: START_HANDLING,
    State.QUEUED: END_HANDLING,  # once more
    State.PLANNING: END_PLANNING,
    State.PLANNED: START_ACHIEVING,
    State.HANDLING: END_HANDLING,
    State.ACHIEVING: END_ACHIEVING,
    State.RECOVERING: END_HANDLING,
    State.SUSPENDED: 0,
    State.ENDING: END_ACHIEVING,
}
"""The moment that a task in a state comes to next (0: it is to be resumed)."""
_ENDS = END_HANDLING | END_PLANNING | END_ACHIEVING
"""The moments that come after its handler has returned."""
_BEGINNING = START_HANDLING | START_PLANNING | START_ACHIEVING
_LATELY = 32
"""Waits of a handler that are looked at, of those that had begun at a moment."""
_OF_ITS_STATE = (WaitKind.CONSTRAINT, WaitKind.PARENT, WaitKind.LISTENER, WaitKind.DELAY, WaitKind.SUBTASK)
"""What keeps a task only since it is in its state: before that something else did."""
_OF_POINTS = (
    WaitKind.CONSTRAINT, WaitKind.SUBTASK, WaitKind.PARENT, WaitKind.LISTENER, WaitKind.RECOVERY, WaitKind.LOCK,
    WaitKind.RESUME,
)  # fmt: skip
_TO_LOOK_UP = (WaitKind.RESOURCE, WaitKind.REPLY, WaitKind.TASK)
_LEAVES = (WaitKind.HANDLER, WaitKind.DELAY, WaitKind.CONDITION, WaitKind.RUNNING)

_START, _SINCE = attrgetter("start"), itemgetter(0)
_Span = TypeVar("_Span", Queueing, Handling, HandlerWait, Suspension)


class Node(NamedTuple):
    """Something that has to come about."""

    number: int
    """The task, message or claim."""
    moment: int = 0
    """What the task is to reach. 0: it is to be resumed, a message answered, a claim granted or, if it was, over."""
    delivery: int = 0
    """Of what was sent to many: the one of them that is to be handled (0: all)."""


class Wait(NamedTuple):
    """One thing that something waits for, and from when until when."""

    start: float
    end: float
    """inf: it goes on."""
    kind: WaitKind
    on: Node
    """What has to come first; of a leaf the thing itself."""
    holds: int
    """The moments of the waiting task that it keeps from being reached, as bits."""
    record: Hold | Queueing | Handling | HandlerWait | Suspension | None = None
    """What it was read off, if that is more than a point of a task."""
    since: float = 0.0
    """Since when it has waited in all without a break, whatever for; no later than *start*."""

    @property
    def seconds(self) -> float:
        """How long it took; infinite, if it goes on."""
        return self.end - self.start


# --- all waits of one record -----------------------------------------------------------------------------------------


def waits_of(run: Run, number: int) -> list[Wait]:
    """All that a task or message ever waited for, oldest first; nothing of what is unknown."""
    message = run.messages.get(number)
    found = sorted(_all(run, message, None), key=_START) if message else []
    return [wait._replace(since=wait.start) for wait in found]


def waits_of_handling(run: Run, handling: Handling, time: float | None = None) -> Iterator[Wait]:
    """One run of a handler: that it runs, and what it blocks for meanwhile; or what it does so at a *time*."""
    end = inf if handling.end is None else handling.end
    waits = handling.waits if time is None else _lately(handling.waits, time)
    if time is None or not waits:
        yield Wait(handling.start, end, WaitKind.RUNNING, node_of(run, handling), _ENDS, handling)
    for wait in waits:
        yield of_handler_wait(run, wait)


def of_handler_wait(run: Run, wait: HandlerWait) -> Wait:
    """What a handler or program blocks for: a reply, a task or a lock."""
    end = inf if wait.end is None else wait.end
    kind = WaitKind.TASK if wait.moment else WaitKind.LOCK if wait.awaited in run.claims else WaitKind.REPLY
    return Wait(wait.start, end, kind, Node(wait.awaited, int(wait.moment or 0)), _ENDS, wait, wait.start)


def node_of(run: Run, handling: Handling) -> Node:
    """That a run of a handler ends."""
    if handling.message_id in run.tasks:
        return Node(handling.message_id, END_HANDLING)
    is_one_of_many = handling.delivery != handling.message_id
    return Node(handling.message_id, 0, handling.delivery if is_one_of_many else 0)


def _all(run: Run, message: Message, time: float | None, wanted: int = -1) -> Iterable[Wait]:
    """All waits of a message; or those at a *time* that hold one of the *wanted* moments, if it is a task."""
    if not isinstance(message, Task):
        return _of_message(run, message, time)
    return chain(_of_task(run, message, time, wanted), _of_message(run, message, time))


def _of_message(run: Run, message: Message, time: float | None) -> Iterator[Wait]:
    """In queues, and while it is handled."""
    queueings, handlings = message.queueings, message.handlings
    if time is not None:
        queueings = _going_on(queueings, time)
        is_to_many = message.message_class.asks_many
        handlings = [one for one in handlings if _is_on(one, time)] if is_to_many else _going_on(handlings, time)
    for queueing in queueings:
        yield _of_queueing(message, queueing)
    for queueing in run.copies.get(message.id, ()):
        if time is None or _is_on(queueing, time):
            yield _of_queueing(message, queueing)
    for handling in handlings:
        yield from waits_of_handling(run, handling, time)


def _of_queueing(message: Message, queueing: Queueing) -> Wait:
    end = inf if queueing.end is None else queueing.end
    kind = WaitKind.RESOURCE if queueing.module else WaitKind.HANDLER
    is_first = isinstance(message, Task) and _time(message, START_HANDLING) > queueing.start
    holds = START_HANDLING if is_first else _ENDS
    return Wait(queueing.start, end, kind, Node(message.id), holds, queueing)


def _of_task(run: Run, task: Task, time: float | None, wanted: int) -> Iterator[Wait]:
    """What keeps a task from its moments, beside queues and handlers."""
    for wait in _of_its_own(run, task):
        if (wait.holds & wanted or wanted < 0) and (
            wait.start < wait.end if time is None else wait.start <= time < wait.end
        ):
            yield wait
    moments = [moment for moment in (END_ACHIEVING, END_PLANNING) if moment & wanted]
    for moment in moments if time is None else moments[:1]:  # what is achieved is planned
        last = _time(task, moment)
        for number in task.children:
            child = run.tasks[number]
            start, end = child.received, min(_time(child, moment), last)
            if start < end if time is None else start <= time < end:
                yield Wait(start, end, WaitKind.SUBTASK, Node(number, moment), moment)


def _of_its_own(run: Run, task: Task) -> Iterator[Wait]:
    killed = inf if task.killed is None else task.written("killed")
    for hold in task.holds:
        yield from _of_constraint(run, task, hold, killed)
    parent = run.tasks.get(task.parent)
    if parent is not None and not task.role:
        for moment in (START_PLANNING, START_ACHIEVING):
            end = min(_time(parent, moment), _time(task, moment), killed)
            if end > task.received:
                yield Wait(task.received, end, WaitKind.PARENT, Node(parent.id, moment), moment)
    if task.suspensions or task.retries or task.failure or task.changes or task.message_class.is_monitor:
        yield from _of_the_rare(run, task)


def _of_the_rare(run: Run, task: Task) -> Iterator[Wait]:
    """Suspensions, failures and conditions, of which most tasks have none."""
    for suspension in task.suspensions:
        yield _of_suspension(task, suspension)
    for retry in task.retries:
        yield from _of_retry(run, task, retry.time)
    yield from _of_recovery(run, task)
    for start, end in watching(task) if task.message_class.is_monitor else ():
        yield Wait(start, end, WaitKind.CONDITION, Node(task.id), _ENDS)


def _of_constraint(run: Run, task: Task, hold: Hold, killed: float) -> Iterator[Wait]:
    """Until a point is reached; then, if it has a delay, until that is over. One between two moments of the task itself
    is none of its own: what holds the first holds the second, too (``_moments``).
    """
    before, moment, delay = hold.constraint.before, hold.constraint.after.moment, hold.constraint.delay
    other, last = run.tasks.get(before.task), min(_time(task, moment), killed)
    met = -inf if other is None else _time(other, before.moment)
    if other is not None and other is not task:
        kind = WaitKind.LISTENER if hold.tap else WaitKind.CONSTRAINT
        yield Wait(hold.added, min(met, last), kind, Node(other.id, int(before.moment)), int(moment), hold)
    if delay:
        over = inf if hold.over is None else hold.over
        yield Wait(max(met, hold.added), min(over, last), WaitKind.DELAY, Node(task.id), int(moment), hold)


def _of_suspension(task: Task, suspension: Suspension) -> Wait:
    """None of its moments that begin something is reached meanwhile; nor is it handled once more."""
    start, end = suspension.start, inf if suspension.end is None else suspension.end
    starts = _BEFORE[task.message_class.is_goal][START_ACHIEVING]
    holds = reduce(or_, (one for one in starts if _time(task, one) > start), 0)
    if not holds and _is_to_be_handled_again(task, start):
        holds = _ENDS
    return Wait(start, end, WaitKind.RESUME, Node(suspension.cause), holds, suspension)


def _of_retry(run: Run, task: Task, retried: float) -> Iterator[Wait]:
    """What is under a task that is to be handled again ends first, in whatever way."""
    place = bisect_right(task.handlings, retried, key=_START)
    if place:
        begun = task.handlings[place].start if place < len(task.handlings) else _time(task, END_ACHIEVING)
        for number in task.children:
            child = run.tasks[number]
            start, end = max(retried, child.received), min(_time(child, END_ACHIEVING), begun)
            yield Wait(start, end, WaitKind.SUBTASK, Node(number, END_ACHIEVING), _ENDS)


def _of_recovery(run: Run, task: Task) -> Iterator[Wait]:
    """The exception handlers that decide, one after the other."""
    called = [run.tasks[number] for number in task.caught_by if number in run.tasks]
    for since, over, state in states_of(task):
        if state is State.RECOVERING:
            if not called:  # the journal begins later
                yield Wait(since, over, WaitKind.RECOVERY, Node(0), _ENDS)
            for handler, later in zip(called, [*(one.received for one in called[1:]), inf], strict=False):
                start, end = max(since, handler.received), min(over, later)
                yield Wait(start, end, WaitKind.RECOVERY, Node(handler.id, END_ACHIEVING), _ENDS)


def states_of(task: Task) -> Iterator[tuple[float, float, State]]:
    """The states of a task, with from when until when it was in each."""
    ends = [*(since for since, _ in task.states[1:]), inf]
    return ((since, end, state) for (since, state), end in zip(task.states, ends, strict=True))


def _time(task: Task, moment: int) -> float:
    """When a task reached that; inf if it has not."""
    reached: dict[Any, float] = task.reached
    return reached.get(moment, inf)


def _is_to_be_handled_again(task: Task, time: float) -> bool:
    """Whether it was retried and not handled since, or its last handler left before it returned."""
    begun = bisect_right(task.handlings, time, key=_START)
    if not begun:
        return True
    last = task.handlings[begun - 1]
    is_cut_off = last.outcome is None and last.end is not None and last.end <= time
    return is_cut_off or any(last.start < retry.time <= time for retry in task.retries)


def _is_on(span: _Span, time: float) -> bool:
    return span.start <= time and (span.end is None or span.end > time)


def _going_on(spans: list[_Span], time: float) -> list[_Span]:
    """The last of some spans, one after the other, that had begun, if it goes on."""
    begun = bisect_right(spans, time, key=_START) if spans else 0
    return spans[begun - 1 : begun] if begun and _is_on(spans[begun - 1], time) else []


def _lately(waits: list[HandlerWait], time: float) -> list[HandlerWait]:
    """Those of a handler's waits that go on, of the last that had begun: several, of a coroutine."""
    begun = bisect_right(waits, time, key=_START) if waits else 0
    return [wait for wait in waits[max(begun - _LATELY, 0) : begun] if wait.end is None or wait.end > time]


# --- at a moment -----------------------------------------------------------------------------------------------------


def next_node(at: RunAt, number: int) -> Node:
    """What a task, message or claim comes to next."""
    if number not in at.tasks:
        return Node(number)
    task = at.tasks[number]
    state = task.state
    if state is State.ENDING:
        return Node(number, END_ACHIEVING)
    if (task.handling or task.watches) and _time(at.run.tasks[number], END_HANDLING) > at.moment:
        return Node(number, END_HANDLING)
    return Node(number, _next_moment(at.run.tasks[number], state, at.moment))


def _next_moment(task: Task, state: State, time: float) -> int:
    """What a task comes to next from a state; of what is handled once more that again."""
    if state is State.QUEUED and _time(task, START_HANDLING) > time:
        return START_HANDLING
    moment = _NEXT.get(state, END_ACHIEVING)
    return END_ACHIEVING if moment == END_HANDLING and _time(task, END_HANDLING) <= time else moment


def keeping(at: RunAt, node: Node) -> list[Wait]:
    """What keeps a task from a moment, or a message from being answered."""
    message = at.run.messages.get(node.number)
    return [] if message is None or message.received > at.moment else _kept(at, message, node).waits


@dataclass(slots=True)
class _Kept:
    """What keeps a node between two turns of its message. So walks through all that waits cost what has changed."""

    turns: int
    """How many there were."""
    waits: list[Wait]
    nodes: list[Node]
    """What surely has to come about first."""
    leaves: list[WaitKind]
    others: list[Wait]
    """Waits whose further nodes are to be looked up at each moment."""


def _kept(at: RunAt, message: Message, node: Node) -> _Kept:
    memo, turns, time = at.run.memo, message.turns, at.moment
    place = len(turns) if not turns or turns[-1] <= time else bisect_right(turns, time)
    known: _Kept | None = memo.get(node)
    if known is None or known.turns != place:
        waits = _look(at.run, message, node, time)
        nodes = dict.fromkeys(wait.on for wait in waits if wait.kind in _OF_POINTS and not _is_leaf(wait))
        leaves = dict.fromkeys(wait.kind for wait in waits if _is_leaf(wait))
        others = [wait for wait in waits if wait.kind in _TO_LOOK_UP]
        known = memo[node] = _Kept(place, waits, list(nodes), list(leaves), others)
    return known


def _is_leaf(wait: Wait) -> bool:
    is_own = isinstance(wait.record, Suspension) and wait.record.cause == wait.record.task
    return wait.kind in _LEAVES or is_own


def _look(run: Run, message: Message, node: Node, time: float) -> list[Wait]:
    if isinstance(message, Task):
        wanted = _moments(message, node.moment, time) if node.moment else -1
        waits = [one for one in _all(run, message, time, wanted) if one.holds & wanted or wanted < 0]
        return waits if node.moment else [one for one in waits if one.kind is WaitKind.RESUME]
    waits = list(_all(run, message, time))
    return [one for one in waits if _delivery(one) == node.delivery] if node.delivery else waits


def _delivery(wait: Wait) -> int:
    """Which delivery a run of a handler, or a wait of one, is."""
    run = wait.record.by if isinstance(wait.record, HandlerWait) else wait.record
    return run.delivery if isinstance(run, Handling) else 0


def _moments(task: Task, moment: int, time: float) -> int:
    """The moments that a task has to reach before that one, and that one, unless it has. A constraint between two of
    its own moments adds what comes before the first.
    """
    if _time(task, moment) <= time:
        return 0
    before = _BEFORE[task.message_class.is_goal]
    found = reduce(or_, (one for one in before[moment] if _time(task, one) > time), 0)
    own = [one.constraint for one in task.holds if one.constraint.before.task == task.id and one.added <= time]
    while own:
        added = [one for its in own if its.after.moment & found for one in before[its.before.moment]]
        more = reduce(or_, (one for one in added if _time(task, one) > time), found)
        if more == found:
            break
        found = more
    return found


def further(at: RunAt, wait: Wait) -> list[Node]:
    """What has to come about before a wait is over; nothing, if it is a leaf, or if that is not known."""
    if wait.kind in _OF_POINTS:
        return [] if _is_leaf(wait) else [wait.on]
    if wait.kind is WaitKind.TASK:
        task = at.run.tasks.get(wait.on.number)
        return [wait.on] if task is not None and _time(task, wait.on.moment) > at.moment else []
    if wait.kind is WaitKind.REPLY:
        message = at.run.messages.get(wait.on.number)
        return [next_node(at, message.id)] if message and message.received <= at.moment else []
    return _nodes(at, keepers_of(at, wait)) if wait.kind is WaitKind.RESOURCE else []


def keepers_of(at: RunAt, wait: Wait) -> Keepers:
    """What keeps a resource from what is queued (RESOURCE), or from who wants to lock it (LOCK)."""
    if isinstance(wait.record, Queueing):
        message = at.run.messages.get(wait.record.message_id)
        return kept_out(at, wait.record.module, wait.record.resource, message) if message else Keepers()
    claim = at.run.claims.get(wait.on.number)
    return ahead_of_claim(at, claim) if claim is not None and not at.is_granted(claim) else Keepers()


def _nodes(at: RunAt, by: Keepers) -> list[Node]:
    """A lock; or the runs of which the first that returns makes room: those that wait for nothing, if there are any."""
    if by.claim is not None:
        return [Node(by.claim.id)]
    going_on = [one for one in by.runs if not at.waits_of(one)]
    return [node_of(at.run, one) for one in going_on or by.runs]


def steps(at: RunAt, node: Node) -> tuple[list[Node], list[WaitKind]]:
    """All that has to come about before a node does; and the kinds of its waits that are leaves."""
    if (claim := at.run.claims.get(node.number)) is not None:
        return _of_claim(at, claim)
    message = at.run.messages.get(node.number)
    if message is None or message.received > at.moment:
        return [], []
    kept = _kept(at, message, node)
    if not kept.others:
        return kept.nodes, kept.leaves
    more = [node for wait in kept.others for node in further(at, wait)]
    return list(dict.fromkeys(kept.nodes + more)), kept.leaves


def _of_claim(at: RunAt, claim: Claim) -> tuple[list[Node], list[WaitKind]]:
    """A lock that is wanted waits for all that is ahead of it. One in force waits for the handler, or else the task,
    for which it was wanted; of a retried one until that is handled again. Outside of handlers it waits for what its
    module waits for there.
    """
    if not at.is_granted(claim):
        by = ahead_of_claim(at, claim)
        return [*(node_of(at.run, one) for one in by.runs), *([Node(by.claim.id)] if by.claim else [])], []
    if claim.by is None:
        nodes = [node for wait in at.waits_outside(claim.sender) for node in further(at, of_handler_wait(at.run, wait))]
        return nodes, [] if nodes else [WaitKind.LOCKED]
    task = at.tasks.get(claim.by.message_id)
    if claim.by.end is None or claim.by.end > at.moment:
        return [node_of(at.run, claim.by)], []
    if task is not None and task.state not in OVER:
        return [Node(task.id, END_HANDLING if task.is_retried else END_ACHIEVING)], []
    return [], []


def held_above(at: RunAt, number: int) -> Iterator[tuple[int, Hold]]:
    """The constraints of tasks above that keep a task from what it comes to next, each with whose it is."""
    above = [wait.on for wait in keeping(at, next_node(at, number)) if wait.kind is WaitKind.PARENT]
    for node in above:  # grows while it is walked
        waits = keeping(at, node)
        yield from ((node.number, wait.record) for wait in waits if isinstance(wait.record, Hold))
        above += [wait.on for wait in waits if wait.kind is WaitKind.PARENT]


# --- as people are told ----------------------------------------------------------------------------------------------


def waits_now(at: RunAt, number: int) -> list[Wait]:
    """What something waits for next. *start* is since when this is its cause: of what is queued, since when the same
    keeps the resource busy.
    """
    waits = keeping(at, next_node(at, number))
    task = at.run.tasks.get(number)
    place = bisect_right(task.states, at.moment, key=_SINCE) - 1 if task else 0
    if task is not None and task.states[place][1] is State.SUSPENDED:
        waits = [*_still_running(at, task), *waits]
    return [_told(at, number, task, place, wait) for wait in waits]


def _told(at: RunAt, number: int, task: Task | None, place: int, wait: Wait) -> Wait:
    if task is not None and _is_of_state(wait, task.states[place][1]):
        since, begun = task.states[place][0], _begun(task, place)
        return wait._replace(start=max(wait.start, since), since=min(begun, max(wait.start, since)))
    if wait.kind in (WaitKind.RESOURCE, WaitKind.LOCK):
        return wait._replace(start=kept_since(at, keepers_of(at, wait), wait.start), since=wait.start)
    start = max(wait.start, _last_outcome(at, number)) if wait.kind is WaitKind.CONDITION else wait.start
    return wait._replace(start=start, since=start)


def _last_outcome(at: RunAt, monitor: int) -> float:
    """Since when the condition of a monitor has held, or has not: the first of the tests in a row that found it so."""
    tests = at.run.tests.get(monitor, [])
    place = bisect_right(tests, at.moment, key=_SINCE)
    while place > 1 and tests[place - 2][1] == tests[place - 1][1]:
        place -= 1
    return tests[place - 1][0] if place > 1 else -inf  # before the first one nothing else was known


def told_waits(run: Run, task: Task) -> list[Wait]:
    """What kept a task from what came next in each of its states, oldest first."""
    found: list[Wait] = []
    waits = waits_of(run, task.id)
    for place, (since, over, state) in enumerate(states_of(task)):
        if state in OVER or over - since < NO_TIME:
            continue
        wanted = _moments_in_state(task, state, since)
        for wait in waits:
            start, end = max(wait.start, since), min(wait.end, over)
            if wait.holds & wanted and end - start >= NO_TIME:
                begun = _begun(task, place) if _is_of_state(wait, state) else start
                found.append(wait._replace(start=start, end=end, since=min(begun, start)))
    return sorted(found, key=_START)


def _moments_in_state(task: Task, state: State, since: float) -> int:
    if state in (State.SUSPENDED, State.RECOVERING):
        return 0 if state is State.SUSPENDED else _BEGINNING | END_HANDLING
    return _moments(task, _next_moment(task, state, since), since)


def _is_of_state(wait: Wait, state: State) -> bool:
    """Whether something keeps a task since it is in its state, and not since the wait as such began."""
    return wait.kind in _OF_ITS_STATE or state is State.ENDING


def _begun(task: Task, place: int) -> float:
    """Since when a task waits that is in one of its states. It goes on with a wait after a suspension."""
    states = task.states
    while place > 1 and [state for _, state in states[place - 2 : place]] == [states[place][1], State.SUSPENDED]:
        place -= 2
    return states[place][0]


def _still_running(at: RunAt, task: Task) -> Iterator[Wait]:
    """The handlers under a suspended task that still work."""
    for run in at.ran_on(at.tasks[task.id]):
        end, start = inf if run.end is None else run.end, at.tasks[task.id].since
        yield Wait(start, end, WaitKind.RUNNING, node_of(at.run, run), 0, run)
