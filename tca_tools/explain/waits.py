"""Why something waits: for each task and message one list of waits, read off its records.

- ``waits_of(run, number)``: all that a task or message ever waited for. Each wait has one cause and one span; several
  may overlap, so the list is linear in the journal.
- ``told_waits(run, task)``: the same as people are told of it, cut to the states of the task. ``waits_now(at, number)``
  is that at a moment.
- ``keeping(at, node)``: what keeps a task from one of its moments, or a message from its answer. What is planned ahead
  is kept from being planned by one thing and from being achieved by another: each wait says which moments it ``holds``.
- ``further(at, wait)``: the nodes that have to come about first; ``steps(at, node)`` does both (ends.py walks on them).

A wait in a queue (RESOURCE) or for a lock (LOCK) leads to what keeps the resource busy (keepers.py). What has no
further nodes is a leaf: HANDLER, DELAY, CONDITION, RUNNING, and RESUME of what was itself suspended. Words come last.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import inf
from operator import attrgetter, itemgetter
from typing import NamedTuple, TypeVar

from tca_tools.explain.keepers import Keepers, ahead_of_claim, kept_out, kept_since
from tca_tools.explain.overlapping import children_within, has_many, worked_out
from tca_tools.explain.retries import of_retry
from tca_tools.explain.wait import Node, Wait, lasting, node_of
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import watches, watching
from tca_tools.journal.records import (
    OVER,
    PLACES,
    Claim,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Queueing,
    Suspension,
    Task,
    TaskState,
    going_on,
    lately,
)
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Overlaps, Span
from tca_wire.points import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    ENDS,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    STARTS,
    TaskId,
)
from tca_wire.rules import rules_of
from tca_wire.waits import NAMED, WaitKind

ALWAYS = -inf, inf
NO_TIME = 1e-6
"""Seconds: what lasts no longer is no wait to tell of."""
_BEFORE = {is_goal: {0: 0, **rules_of(is_goal).no_later} for is_goal in (True, False)}
"""As bits all that comes no later than a moment, and the moment: of a goal (True), and of what only acts."""
_NEXT = {
    TaskState.HELD: START_HANDLING,
    TaskState.QUEUED: END_HANDLING,  # once more
    TaskState.PLANNING: END_PLANNING,
    TaskState.PLANNED: START_ACHIEVING,
    TaskState.HANDLING: END_HANDLING,
    TaskState.ACHIEVING: END_ACHIEVING,
    TaskState.RECOVERING: END_HANDLING,
    TaskState.SUSPENDED: 0,
    TaskState.ENDING: END_ACHIEVING,
}
"""The moment that a task in a state comes to next (0: it is to be resumed)."""
_OF_ORDER = {WaitKind.CONSTRAINT, WaitKind.PARENT, WaitKind.LISTENER, WaitKind.SUBTASK}
_OF_ITS_STATE = _OF_ORDER | {WaitKind.DELAY}
"""Causes that keep a task only since it is in its state: before that something else did."""
_OF_POINTS = _OF_ORDER | {WaitKind.RECOVERY, WaitKind.LOCK, WaitKind.RESUME}
_KEPT = (WaitKind.RESOURCE, WaitKind.LOCK)
"""Waits for a resource that others keep busy."""

_Span = TypeVar("_Span", Queueing, Handling)
_START, _SINCE, _SPAN = attrgetter("start"), itemgetter(0), attrgetter("start", "end")


# --- all waits of one record -----------------------------------------------------------------------------------------


def waits_of(run: Run, number: int) -> list[Wait]:
    """All that a task or message ever waited for, oldest first; nothing of what is unknown."""
    message = run.messages.get(number)
    if message is None:
        return []
    if isinstance(message, Task) and has_many(message):
        return worked_out(run, (waits_of, number), lambda: _all_waits(run, message))
    return _all_waits(run, message)


def _all_waits(run: Run, message: Message) -> list[Wait]:
    found: list[Wait] = []
    if isinstance(message, Task):
        found += _of_task(run, message)
        for moment in (END_ACHIEVING, END_PLANNING):
            found += _subtasks(run, message, moment)
    found += _of_message(run, message)
    return [wait._replace(since=wait.start) for wait in sorted(found, key=_START)]


def _of_message(run: Run, message: Message, time: float | None = None) -> Iterator[Wait]:
    """In queues, and while it is handled; only what goes on at a *time*."""
    is_one = isinstance(message, Task)  # of others there may be several at once
    begun = message.time_of(START_HANDLING) if isinstance(message, Task) else -inf
    queueings = _lasting(message.queueings, time)
    copies = _lasting(run.copies.get(message.id, ()), time, is_one=False)
    for queueing in (*queueings, *copies):
        kind = WaitKind.RESOURCE if queueing.module else WaitKind.HANDLER
        holds = START_HANDLING if begun > queueing.start else ENDS
        yield lasting(queueing, kind, Node(message.id), holds)
    for handling in _lasting(message.handlings, time, is_one=is_one):
        waits = handling.waits if time is None else lately(handling.waits, time)
        if time is None or not waits:
            yield lasting(handling, WaitKind.RUNNING, node_of(run, handling), ENDS)
        yield from (of_handler_wait(run, wait) for wait in waits)


def _lasting(spans: Sequence[_Span], time: float | None, *, is_one: bool = True) -> Sequence[_Span]:
    """All spans, or (at a *time*) those that go on then: *is_one*, if they come one after the other."""
    if time is None:
        return spans
    if not is_one:
        return [one for one in spans if one.goes_on(time)]
    last = going_on(spans, time)
    return [last] if last is not None else []


def of_handler_wait(run: Run, wait: HandlerWait) -> Wait:
    """The wait of a handler or program for a reply, a task or a lock; or for a change, or for handlers."""
    kind = wait.kind
    if kind is WaitKind.TASK and not wait.moment:
        kind = WaitKind.LOCK if wait.awaited in run.claims else WaitKind.REPLY
    return lasting(wait, kind, Node(wait.awaited, int(wait.moment or 0)), ENDS)


def _subtasks(run: Run, task: Task, moment: int, window: Span = ALWAYS, *, together: bool = False) -> Iterator[Wait]:
    """The waits for tasks right under a task, which keep it from being planned or achieved, as far as they lie between
    two times. *together*: of those that begin at one time, only the first ones, of which the last stands for the rest.
    """
    since, over = window
    last, number, begun = min(task.time_of(moment), over), 0, -inf
    others: list[float] = []
    children = children_within(run, task, moment, since, over)
    for child in _under(run, children, moment, None):
        start, end = max(child.received, since), min(child.time_of(moment), last)
        if start >= end or (together and end - start < NO_TIME):
            continue
        number, begun = number + 1 if start == begun else 1, start
        if number > NAMED and together:
            others.append(end)
            continue
        others = []
        wait = Wait(start, end, WaitKind.SUBTASK, Node(child.id, moment), moment)
        yield wait._replace(others=others) if together else wait


def _under(run: Run, children: Sequence[TaskId], moment: int, time: float | None) -> list[Task]:
    """The tasks that keep the one they are under from being planned or achieved, at a *time* or ever. Of a monitor that
    ends with all else there it is what that has sent, unless a constraint keeps it.
    """
    found: list[Task] = []
    rest = [*reversed(children)]
    while rest:
        child = run.tasks[rest.pop()]
        is_aside = child.message_class.is_aside and not child.is_waited_for
        if moment != END_ACHIEVING or not is_aside:
            found.append(child)
            continue
        if is_kept := _is_kept(run, child, time):
            found.append(child)
        if time is None:
            rest += reversed(child.children)
        elif not is_kept:
            rest += reversed(children_within(run, child, moment, time, time))
    return found


def _is_kept(run: Run, monitor: Task, time: float | None) -> bool:
    """Whether a constraint keeps a monitor from its end; what comes before it is handled once more does not."""
    for hold in monitor.holds:
        for wait in _of_constraint(run, monitor, hold, _killed(monitor)):
            is_of_end = wait.holds in (END_HANDLING, END_ACHIEVING) and wait.kind is not WaitKind.DELAY
            if is_of_end and (time is None or wait.start <= time < wait.end):
                return True
    return False


def _killed(task: Task) -> float:
    return inf if task.killed is None else task.written("killed")


def _of_task(run: Run, task: Task) -> Iterator[Wait]:
    """The waits of a task other than for queues, handlers and its children."""
    killed, found = _killed(task), list[Wait]()
    for hold in task.holds:
        found += _of_constraint(run, task, hold, killed)
    parent = run.tasks.get(task.parent)
    if parent is not None and not task.role:
        for moment in (START_PLANNING, START_ACHIEVING):
            end = min(parent.time_of(moment), task.time_of(moment), killed)
            on = Node(parent.id, moment)
            found.append(Wait(task.received, end, WaitKind.PARENT, on, moment))
    found += [_of_suspension(task, suspension) for suspension in task.suspensions]
    again: dict[object, Wait] = {}  # retried twice before it is handled, it waits once
    for retry in reversed(task.retries):
        for wait in of_retry(run, task, retry, killed, _under):
            again[wait.on, wait.end] = wait
    found += again.values()
    if task.caught_by or task.is_recovering or task.changes:
        found += _of_recovery(run, task)
    if task.message_class.is_monitor:
        found += [Wait(*span, WaitKind.CONDITION, Node(task.id), ENDS) for span in watching(task)]
    return (wait for wait in found if wait.start < wait.end)


def _own(run: Run, task: Task, start: float, end: float) -> Iterable[Wait]:
    """Those of a task that go on between two times, perhaps with others."""
    if not has_many(task):
        return _of_task(run, task)
    known = worked_out(run, (_own, task.id), lambda: Overlaps(_of_task(run, task), _SPAN))
    return known.within(start, end)


def _of_constraint(run: Run, task: Task, hold: Hold, killed: float) -> Iterator[Wait]:
    """Until a point is reached; then, if it has a delay, until that is over. One between two moments of the task itself
    is none of its own: what holds the first holds the second, too (``_moments``).
    """
    before, moment = hold.constraint.before, int(hold.constraint.after.moment)
    # whether it is to be handled once more
    is_anew = hold.tap is not None and task.time_of(moment) < hold.added
    last = min(task.time_of(END_ACHIEVING if is_anew else moment), killed)
    other, met = run.tasks.get(before.task), -inf
    if other is not None:
        met = other.time_of(before.moment)
    if other is not None and other is not task:
        kind = WaitKind.LISTENER if hold.tap else WaitKind.CONSTRAINT
        on = Node(other.id, int(before.moment))
        yield Wait(hold.added, min(met, last), kind, on, ENDS if is_anew else moment, hold)
    if hold.constraint.delay:
        start, end = max(met, hold.added), min(hold.over, last)
        yield Wait(start, end, WaitKind.DELAY, Node(task.id), moment, hold)


def _of_suspension(task: Task, suspension: Suspension) -> Wait:
    """The wait of a suspended task: it neither begins an interval nor is handled once more."""
    start = suspension.start
    holds = _BEFORE[task.message_class.is_goal][START_ACHIEVING] & ~_past(task, start)
    if not holds and _is_to_be_handled_again(task, start):
        holds = ENDS
    return lasting(suspension, WaitKind.RESUME, Node(suspension.cause), holds)


def _of_recovery(run: Run, task: Task) -> Iterator[Wait]:
    """The exception handlers that decide, one after the other, and those for failures raised beside its handler."""
    called = [run.tasks[number] for number in task.caught_by if number in run.tasks]
    known = [run.tasks[number] for number in task.deciders if number in run.tasks]
    until = {one.id: later.received for one, later in pairwise(known)}
    waits = []
    for one in called:
        end = min(until.get(one.id, inf), one.time_of(END_ACHIEVING))
        waits.append(Wait(one.received, end, WaitKind.RECOVERY, Node(one.id, END_ACHIEVING), ENDS))
    if not called:  # the journal begins later
        waits = [Wait(-inf, inf, WaitKind.RECOVERY, Node(0), ENDS)]
    deciding = Overlaps(waits, _SPAN)
    for since, over, state in task.spans():
        if state is TaskState.RECOVERING:
            for wait in deciding.within(since, over):
                yield wait._replace(start=max(since, wait.start), end=min(over, wait.end))


def _is_to_be_handled_again(task: Task, time: float) -> bool:
    """Whether it was retried and not handled since, or its last handler left before it returned."""
    begun = bisect_right(task.handlings, time, key=_START)
    if not begun:
        return True
    last = task.handlings[begun - 1]
    is_cut_off = last.outcome is None and last.end is not None and last.end <= time
    return is_cut_off or task.was_retried(time)


# --- at a moment -----------------------------------------------------------------------------------------------------


class _Kept(NamedTuple):
    """The waits and nodes that keep a node from coming about."""

    waits: list[Wait]
    """Those for what is no subtask."""
    subtasks: list[Node]
    nodes: list[Node]
    """Nodes that surely have to come about first."""
    leaves: list[WaitKind]
    others: list[Wait]
    """Waits whose further nodes are to be looked up at each moment."""


_NOTHING = _Kept([], [], [], [], [])


class _Turn(NamedTuple):
    """A message between two of its turns, when nothing changes that it waits for. So walks through all that waits cost
    what has changed.
    """

    number: float
    """See ``Run.turn``."""
    next: Node
    """The node that comes next."""
    waits: list[Wait]
    """The waits for it, except for children."""
    kept: dict[Node, _Kept]


def _turn(run: Run, message: Message, time: float) -> _Turn:
    number = run.turn(message.id, time)
    known: _Turn | None = run.memo.get(message.id)
    if known is None or known.number != number:
        waits, following = list(_of_message(run, message, time)), Node(message.id)
        if isinstance(message, Task):
            waits[:0] = (one for one in _own(run, message, time, time) if one.start <= time < one.end)
            following = _next(message, time)
        known = run.memo[message.id] = _Turn(number, following, waits, {})
    return known


def next_node(at: RunAt, number: int) -> Node:
    """The next node of a task, message or claim."""
    task = at.run.tasks.get(number)
    if task is None or task.received > at.moment:
        return Node(number)
    return _turn(at.run, task, at.moment).next


def _next(task: Task, time: float) -> Node:
    state = task.state_at(time)
    runs = bool(going_on(task.handlings, time)) or watches(task, state, time)
    if runs and state is not TaskState.ENDING and task.time_of(END_HANDLING) > time:
        return Node(task.id, END_HANDLING)
    return Node(task.id, _next_moment(task, state, time))


def _next_moment(task: Task, state: TaskState, time: float) -> int:
    """The next moment of a task in a state; a task handled once more comes to the same one again."""
    if state is TaskState.QUEUED and task.time_of(START_HANDLING) > time:
        return START_HANDLING
    moment = _NEXT.get(state, END_ACHIEVING)
    is_past = moment == END_HANDLING and task.time_of(END_HANDLING) <= time
    return END_ACHIEVING if is_past else moment


def keeping(at: RunAt, node: Node) -> list[Wait]:
    """The waits that keep a task from a moment, or a message from being answered."""
    kept = _kept(at, node)
    return kept.waits + [_subtask(at.run, one) for one in kept.subtasks]


def _subtask(run: Run, node: Node, others: Sequence[float] = ()) -> Wait:
    child, moment = run.tasks[node.number], node.moment
    end = min(child.time_of(moment), run.tasks[child.parent].time_of(moment))
    return Wait(child.received, end, WaitKind.SUBTASK, node, moment, others=others)


def _kept(at: RunAt, node: Node) -> _Kept:
    """What keeps a node from coming about; nothing of a claim, and of what is unknown."""
    run, moment = at.run, at.moment
    message = run.messages.get(node.number)
    if message is None or message.received > moment:
        return _NOTHING
    turn = _turn(run, message, moment)
    if (kept := turn.kept.get(node)) is None:
        waits, subtasks = _look(run, message, node, turn.waits, moment)
        nodes: dict[Node, None] = {}
        leaves: dict[WaitKind, None] = {}
        others: list[Wait] = []
        for wait in waits:
            if wait.is_leaf:
                leaves[wait.kind] = None
            elif wait.kind in _OF_POINTS:
                nodes[wait.on] = None
            else:
                others.append(wait)
        nodes.update(dict.fromkeys(subtasks))
        kept = turn.kept[node] = _Kept(waits, subtasks, list(nodes), list(leaves), others)
    return kept


def _look(run: Run, message: Message, node: Node, waits: list[Wait], time: float) -> tuple[list[Wait], list[Node]]:
    """Those of the waits that keep it from a node, and the subtasks that do."""
    if not isinstance(message, Task):
        return [one for one in waits if node.delivery in (0, _delivery(one))], []
    if not node.moment:
        return [one for one in waits if one.kind is WaitKind.RESUME], []
    wanted = _moments(message, node.moment, time)
    found = [one for one in waits if one.holds & wanted or (wanted and _resumes(message, one, time))]
    last = wanted & END_ACHIEVING or wanted & END_PLANNING  # what is achieved is planned
    if not last:
        return found, []
    named = {one.on for one in found if one.kind in (WaitKind.SUBTASK, WaitKind.RECOVERY)}
    under = _under(run, children_within(run, message, last, time, time), last, time)
    subtasks = (Node(one.id, last) for one in under if one.received <= time < one.time_of(last))
    return found, [one for one in subtasks if one not in named]


def _resumes(task: Task, wait: Wait, time: float) -> bool:
    """Whether it is for a task to be resumed that, as was decided meanwhile, is to be handled once more."""
    begun = wait.kind is WaitKind.RESUME and task.time_of(START_HANDLING) <= time
    return begun and _is_to_be_handled_again(task, time)


def _delivery(wait: Wait) -> int:
    """Which delivery a run of a handler, or a wait of one, is."""
    run = wait.record.by if isinstance(wait.record, HandlerWait) else wait.record
    return run.delivery if isinstance(run, Handling) else 0


def _moments(task: Task, moment: int, time: float) -> int:
    """The moments that a task has to reach before that one, and that one, unless it has. A constraint between two of
    its own moments adds what comes before the first.
    """
    if task.time_of(moment) <= time:
        is_again = moment == END_HANDLING and (going_on(task.handlings, time) or task.was_retried(time))
        return END_HANDLING if is_again else 0  # it is handled again, or to be
    if _killed(task) <= time:  # it reaches none before its handler has returned
        return END_HANDLING | (moment & ENDS)
    before = _BEFORE[task.message_class.is_goal]
    left = ~_past(task, time)
    found = before[moment] & left
    known = (one.constraint for one in task.holds if one.added <= time)
    own = [one for one in known if one.before.task == task.id]
    for one in own * len(own):  # each may add what the next one needs
        found |= before[one.before.moment] & left if one.after.moment & found else 0
    return found


def _past(task: Task, time: float) -> int:
    """The moments that a task had reached, as bits."""
    past = 0
    for moment, place in PLACES.items():
        past |= moment if task.times[place] <= time else 0
    return past


def further(at: RunAt, wait: Wait) -> list[Node]:
    """The nodes that must come about before a wait is over; empty for a leaf, or if they are not known."""
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
        is_to_come = number in at.run.messages and at.run.messages[number].received <= at.moment
    else:
        return [wait.on]
    on = wait.on if wait.kind is WaitKind.TASK else next_node(at, number)
    return [on] if is_to_come else []


def keepers_of(at: RunAt, wait: Wait) -> Keepers:
    """The keepers of a resource from a queued message (RESOURCE) or a lock (LOCK)."""
    queueing, claim = wait.record, at.run.claims.get(wait.on.number)
    if isinstance(queueing, Queueing):
        message = at.run.messages.get(queueing.message_id)
        return kept_out(at, queueing.module, queueing.resource, message) if message else Keepers()
    return Keepers() if claim is None or at.is_granted(claim) else ahead_of_claim(at, claim)


def _nodes(at: RunAt, by: Keepers) -> list[Node]:
    """A lock; or the runs of which the first that returns makes room: those that wait for nothing, if there are any."""
    if by.claim is not None:
        return [Node(by.claim.id)]
    free = [one for one in by.runs if not lately(one.waits, at.moment)]
    return [node_of(at.run, one) for one in free or by.runs]


def steps(at: RunAt, node: Node) -> tuple[list[Node], list[WaitKind]]:
    """All that has to come about before a node does; and the kinds of its waits that are leaves."""
    kept = _kept(at, node)
    if kept is _NOTHING and (claim := at.run.claims.get(node.number)) is not None:
        return _of_claim(at, claim)
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
    """The constraints of tasks above that keep a task from what it comes to next, each with whose it is."""
    way = [next_node(at, number)]
    for node in way:  # grows while it is walked
        for wait in _kept(at, node).waits:
            if isinstance(wait.record, Hold) and node is not way[0]:
                yield node.number, wait.record
            way += [wait.on] * (wait.kind is WaitKind.PARENT)


# --- as people are told ----------------------------------------------------------------------------------------------


def waits_now(at: RunAt, number: int) -> list[Wait]:
    """The waits of a message now. *start* is since when this is its cause: of a queued one, since when the same keeps
    the resource busy. The newest of many subtasks stands for all but the first ones.
    """
    kept = _kept(at, next_node(at, number))
    waits = [*kept.waits, *(_subtask(at.run, one) for one in kept.subtasks[:-1][:NAMED])]
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
        if _is_of_state(wait, state):
            start = max(wait.start, since)
            told.append(wait._replace(start=start, since=min(_begun(task, place), start)))
        else:
            told.append(_told(at, wait))
    return told


def _told(at: RunAt, wait: Wait) -> Wait:
    """A wait since its cause is the cause."""
    start = wait.start
    if wait.kind in _KEPT:
        return wait._replace(start=kept_since(at, keepers_of(at, wait), start), since=start)
    if wait.kind is WaitKind.CONDITION:
        start = max(start, _last_outcome(at, wait.on.number))
    return wait._replace(start=start, since=start)


def _last_outcome(at: RunAt, monitor: int) -> float:
    """Since when the condition of a monitor has held, or has not: the first of the tests in a row that found it so."""
    tests = at.run.tests.get(monitor, [])
    place = bisect_right(tests, at.moment, key=_SINCE)
    while place > 1 and tests[place - 2][1] == tests[place - 1][1]:
        place -= 1
    return tests[place - 1][0] if place > 1 else -inf  # before the first one nothing else was known


def told_waits(run: Run, task: Task, *, together: bool = False) -> list[Wait]:
    """The waits of a task for what came next in each of its states, oldest first. *together*: of subtasks that it waits
    for from one time on, the last that is named stands for the rest.
    """
    found: list[Wait] = []
    own = Overlaps(_of_task(run, task), _SPAN)
    handled = Overlaps(_of_message(run, task), _SPAN)
    for place, (since, over, state) in enumerate(task.spans()):
        if state in OVER or over - since < NO_TIME:
            continue
        wanted, begun = _moments_in_state(task, state, since), _begun(task, place)
        waits = [(one.start, one) for one in own.within(since, over)]
        for moment in (END_ACHIEVING, END_PLANNING):
            if moment & wanted:
                some = _subtasks(run, task, moment, (since, over), together=together)
                waits += ((run.tasks[one.on.number].received, one) for one in some)
        waits += ((one.start, one) for one in handled.within(since, over))
        for _, wait in sorted(waits, key=_SINCE):
            start, end = max(wait.start, since), min(wait.end, over)
            if wait.holds & wanted and end - start >= NO_TIME:
                of_all = min(begun, start) if _is_of_state(wait, state) else start
                found.append(wait._replace(start=start, end=end, since=of_all))
    return sorted(found, key=_START)


def _moments_in_state(task: Task, state: TaskState, since: float) -> int:
    if state in (TaskState.SUSPENDED, TaskState.RECOVERING):
        return 0 if state is TaskState.SUSPENDED else STARTS | END_HANDLING
    return _moments(task, _next_moment(task, state, since), since)


def _is_of_state(wait: Wait, state: TaskState) -> bool:
    """Whether something keeps a task since it is in its state, and not since the wait as such began."""
    return wait.kind in _OF_ITS_STATE or state is TaskState.ENDING


def _begun(task: Task, place: int) -> float:
    """Since when a task waits that is in one of its states. It goes on with a wait after a suspension."""
    state = task.stage(place)[1]
    while place > 1 and (task.stage(place - 2)[1], task.stage(place - 1)[1]) == (state, TaskState.SUSPENDED):
        place -= 2
    return task.stage(place)[0]


def _still_running(at: RunAt, task: Task) -> Iterator[Wait]:
    """The handlers under a suspended task that still work."""
    now = at.tasks[task.id]
    for run in at.ran_on(now):
        wait = lasting(run, WaitKind.RUNNING, node_of(at.run, run), 0)
        yield wait._replace(start=max(now.since, run.start))
