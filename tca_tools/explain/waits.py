"""The list of waits: for each task and message all that it waited for, read off its records.

- ``waits_of(run, number)``: all that a task or message ever waited for. Each wait has one cause and
one span; several
  may overlap, so the list is linear in the journal.
- ``waits_for_display(run, task)``: the same as people are told of it, cut to the states of the task.

graph.py has what was so at a moment. Words come last.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import inf
from operator import attrgetter, itemgetter
from typing import NamedTuple, TypeVar

from tca_tools.explain.deciding import decider
from tca_tools.explain.overlapping import children_within, has_many, worked_out
from tca_tools.journal.fates import watching
from tca_tools.journal.records import (
    OVER,
    PLACES,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Queueing,
    Retry,
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
from tca_wire.rules import RULES
from tca_wire.waits import NAMED, WaitKind

_ALWAYS = -inf, inf
NO_TIME = 1e-6
"""Seconds: what lasts no longer is no wait to tell of."""
_OF_ORDER = {WaitKind.CONSTRAINT, WaitKind.PARENT, WaitKind.LISTENER, WaitKind.SUBTASK}
"""Waits for points of other tasks that the order of tasks demands."""
_OF_ITS_STATE = _OF_ORDER | {WaitKind.DELAY}
"""Causes that keep a task only since it is in its state: before that something else did."""

_Span = TypeVar("_Span", Queueing, Handling)
_START, _SINCE, _SPAN = attrgetter("start"), itemgetter(0), attrgetter("start", "end")
_LEAVES = (
    WaitKind.HANDLER,
    WaitKind.DELAY,
    WaitKind.CONDITION,
    WaitKind.RUNNING,
    WaitKind.PRESENCE,
)


class Node(NamedTuple):
    """Something that has to come about."""

    number: int
    """The task, message or claim."""
    moment: int = 0
    """The moment that the task is to reach. 0: it is to be resumed, answered, or its claim granted
    or released.
    """
    delivery: int = 0
    """Of what was sent to many: the one of them that is to be handled (0: all)."""


class Wait(NamedTuple):
    """One thing that something waits for, and from when until when."""

    start: float
    end: float
    """inf: it goes on."""
    kind: WaitKind
    on: Node
    """The node that has to come first; of a leaf the thing itself."""
    holds: int
    """The moments of the waiting task that it keeps from being reached, as bits."""
    record: Hold | Queueing | Handling | HandlerWait | Suspension | None = None
    """The record of the wait, if that is more than a point of a task."""
    since: float = 0.0
    """Since when it has waited in all without a break, whatever for; no later than *start*."""
    others: Sequence[float] = ()
    """The ends of further subtasks that it stands for."""

    @property
    def is_leaf(self) -> bool:
        """Whether nothing else has to come about first."""
        is_own = isinstance(self.record, Suspension) and self.record.cause == self.record.task
        return (
            self.kind in _LEAVES or is_own or (self.kind is WaitKind.CHANGE and not self.on.number)
        )


def lasting(
    record: Queueing | Handling | HandlerWait | Suspension, kind: WaitKind, on: Node, holds: int
) -> Wait:
    """A wait that lasts as long as its record."""
    return Wait(record.start, record.until, kind, on, holds, record, record.start)


def has_come(run: Run, wait: HandlerWait) -> bool:
    """Whether what a handler waited for a task for had come when the wait was over; True if it is
    no certain task.
    """
    task = run.tasks.get(wait.awaited)
    if task is None or wait.end is None:
        return task is None
    if wait.kind is WaitKind.CHANGE:
        return wait.end in task.times or any(one.time == wait.end for one in task.life or ())
    return wait.moment is None or task.time_of(wait.moment) <= wait.end


def node_of(run: Run, handling: Handling) -> Node:
    """That a run of a handler ends."""
    if handling.message_id in run.tasks:
        return Node(handling.message_id, END_HANDLING)
    is_one_of_many = handling.delivery != handling.message_id
    return Node(handling.message_id, 0, handling.delivery if is_one_of_many else 0)


# --- the moments of a task that matter at a time --------------------------------------------------

_NO_LATER = [{0: 0, **rules.no_later} for rules in RULES]
"""As bits all that comes no later than a moment, and the moment: of a goal (True), and of what only
acts.
"""
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


def killed_at(task: Task) -> float:
    """When a task was killed; inf if it was not."""
    return inf if task.killed is None else task.written("killed")


def past(task: Task, time: float) -> int:
    """The moments that a task had reached, as bits."""
    past = 0
    for moment, place in PLACES.items():
        past |= moment if task.times[place] <= time else 0
    return past


def next_moment(task: Task, state: TaskState, time: float) -> int:
    """The next moment of a task in a state; a task handled once more comes to the same one
    again.
    """
    if state is TaskState.QUEUED and task.time_of(START_HANDLING) > time:
        return START_HANDLING
    moment = _NEXT.get(state, END_ACHIEVING)
    is_past = moment == END_HANDLING and task.time_of(END_HANDLING) <= time
    return END_ACHIEVING if is_past else moment


def moments_before(task: Task, moment: int, time: float) -> int:
    """The moments that a task has to reach before that one, and that one, unless it has. A
    constraint between two of its own moments adds what comes before the first.
    """
    if task.time_of(moment) <= time:
        is_again = moment == END_HANDLING and (
            going_on(task.handlings, time) or task.was_retried(time)
        )
        return END_HANDLING if is_again else 0  # it is handled again, or to be
    if killed_at(task) <= time:  # it reaches none before its handler has returned
        return END_HANDLING | (moment & ENDS)
    before = _NO_LATER[task.message_class.is_goal]
    left = ~past(task, time)
    found = before[moment] & left
    known = (one.constraint for one in task.holds if one.added <= time)
    own = [one for one in known if one.before.task == task.id]
    for one in own * len(own):  # each may add what the next one needs
        found |= before[one.before.moment] & left if one.after.moment & found else 0
    return found


def is_to_be_handled_again(task: Task, time: float) -> bool:
    """Whether it was retried and not handled since, or its last handler left before it returned."""
    begun = bisect_right(task.handlings, time, key=_START)
    if not begun:
        return True
    last = task.handlings[begun - 1]
    is_cut_off = last.outcome is None and last.end is not None and last.end <= time
    return is_cut_off or task.was_retried(time)


# --- all waits of one record ----------------------------------------------------------------------


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
    found += of_message(run, message)
    return [wait._replace(since=wait.start) for wait in sorted(found, key=_START)]


def of_message(run: Run, message: Message, time: float | None = None) -> Iterator[Wait]:
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
    """All spans, or (at a *time*) those that go on then: *is_one*, if they come one after the
    other.
    """
    if time is None:
        return spans
    if not is_one:
        return [one for one in spans if one.goes_on(time)]
    last = going_on(spans, time)
    return [last] if last is not None else []


def of_handler_wait(run: Run, wait: HandlerWait) -> Wait:
    """The wait of a handler or program for a reply, a task or a lock; or for a change, or for
    handlers.
    """
    kind = wait.kind
    if kind is WaitKind.TASK and not wait.moment:
        kind = WaitKind.LOCK if wait.awaited in run.claims else WaitKind.REPLY
    return lasting(wait, kind, Node(wait.awaited, int(wait.moment or 0)), ENDS)


def _subtasks(
    run: Run, task: Task, moment: int, window: Span = _ALWAYS, *, together: bool = False
) -> Iterator[Wait]:
    """The waits for tasks right under a task, which keep it from being planned or achieved, as far
    as they lie between two times. *together*: of those that begin at one time, only the first ones,
    of which the last stands for the rest.
    """
    since, over = window
    last, number, begun = min(task.time_of(moment), over), 0, -inf
    others: list[float] = []
    children = children_within(run, task, moment, since, over)
    for child in kept_by(run, children, moment, None):
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


def kept_by(run: Run, children: Sequence[TaskId], moment: int, time: float | None) -> list[Task]:
    """The tasks that keep the one they are under from being planned or achieved, at a *time* or
    ever. Of a monitor that ends with all else there it is what that has sent, unless a constraint
    keeps it.
    """
    found: list[Task] = []
    rest = [*reversed(children)]
    while rest:
        child = run.tasks[rest.pop()]
        is_outside_sequence = child.message_class.is_outside_sequence and not child.is_waited_for
        if moment != END_ACHIEVING or not is_outside_sequence:
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
    """Whether a constraint keeps a monitor from its end; what comes before it is handled once more
    does not.
    """
    for hold in monitor.holds:
        for wait in _of_constraint(run, monitor, hold, killed_at(monitor)):
            goes_on = time is None or wait.start <= time < wait.end
            is_of_end = wait.holds in (END_HANDLING, END_ACHIEVING)
            if goes_on and is_of_end and wait.kind is not WaitKind.DELAY:
                return True
    return False


def _of_task(run: Run, task: Task) -> Iterator[Wait]:
    """The waits of a task other than for queues, handlers and its children."""
    killed, found = killed_at(task), list[Wait]()
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
        for wait in _of_retry(run, task, retry, killed):
            again[wait.on, wait.end] = wait
    found += again.values()
    if task.caught_by or task.is_recovering or task.changes:
        found += _of_recovery(run, task)
    if task.message_class.is_monitor:
        found += [Wait(*span, WaitKind.CONDITION, Node(task.id), ENDS) for span in watching(task)]
    return (wait for wait in found if wait.start < wait.end)


def own_waits(run: Run, task: Task, start: float, end: float) -> Iterable[Wait]:
    """Those of a task that go on between two times, perhaps with others."""
    if not has_many(task):
        return _of_task(run, task)
    known = worked_out(run, (own_waits, task.id), lambda: Overlaps(_of_task(run, task), _SPAN))
    return known.within(start, end)


def _of_constraint(run: Run, task: Task, hold: Hold, killed: float) -> Iterator[Wait]:
    """Until a point is reached; then, if it has a delay, until that is over. One between two
    moments of the task itself is none of its own: what holds the first holds the second, too
    (``moments_before``).
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
        holds = ENDS if is_anew else moment
        yield Wait(hold.added, min(met, last), kind, on, holds, hold)
    if hold.constraint.delay:
        start, end = max(met, hold.added), min(hold.over, last)
        yield Wait(start, end, WaitKind.DELAY, Node(task.id), moment, hold)


def _of_suspension(task: Task, suspension: Suspension) -> Wait:
    """The wait of a suspended task: it neither begins an interval nor is handled once more."""
    start = suspension.start
    holds = _NO_LATER[task.message_class.is_goal][START_ACHIEVING] & ~past(task, start)
    if not holds and is_to_be_handled_again(task, start):
        holds = ENDS
    return lasting(suspension, WaitKind.RESUME, Node(suspension.cause), holds)


def _of_recovery(run: Run, task: Task) -> Iterator[Wait]:
    """The exception handlers that decide, one after the other, and those for failures raised beside
    its handler.
    """
    called = [run.tasks[number] for number in task.caught_by if number in run.tasks]
    known = [run.tasks[number] for number in task.deciders if number in run.tasks]
    until = {one.id: later.received for one, later in pairwise(known)}
    waits = []
    for one in called:
        on, end = Node(one.id, END_ACHIEVING), one.time_of(END_ACHIEVING)
        end = min(until.get(one.id, inf), end)
        waits.append(Wait(one.received, end, WaitKind.RECOVERY, on, ENDS))
    if not called:  # the journal begins later
        waits = [Wait(-inf, inf, WaitKind.RECOVERY, Node(0), ENDS)]
    deciding = Overlaps(waits, _SPAN)
    for since, over, state in task.spans():
        if state is TaskState.RECOVERING:
            for wait in deciding.within(since, over):
                start, end = max(since, wait.start), min(over, wait.end)
                yield wait._replace(start=start, end=end)


# --- what is to be handled again ------------------------------------------------------------------


def _of_retry(run: Run, task: Task, retry: Retry, killed: float) -> Iterator[Wait]:
    """The waits of a task that is to be handled again, unless it is killed, for all tasks under it
    to end: then it is queued, or handled.
    """
    if task.time_of(START_HANDLING) >= retry.time:
        return
    begun = _begun(task, retry)
    is_over = min(begun, killed)
    asker = decider(run, retry.asker)
    if asker is not None:
        end, on = min(asker.time_of(END_ACHIEVING), is_over), Node(asker.id, END_ACHIEVING)
        yield Wait(retry.time, end, WaitKind.RECOVERY, on, ENDS)
    still = children_within(run, task, END_ACHIEVING, retry.time, begun)
    children = [run.tasks[number] for number in still]
    if task.message_class.is_monitor:
        children = _before_it_begins(task, retry, children, asker)
    awaited = [TaskId(child.id) for child in children if not child.outlives_retry]
    for child in kept_by(run, awaited, END_ACHIEVING, retry.time):
        if child is not asker:
            start, on = max(retry.time, child.received), Node(child.id, END_ACHIEVING)
            end = min(child.time_of(END_ACHIEVING), is_over)
            yield Wait(start, end, WaitKind.SUBTASK, on, ENDS)


def _begun(task: Task, retry: Retry) -> float:
    """When a retried task was queued or handled, or else ended."""
    queued = bisect_left(task.queueings, retry.time, key=_START)
    starts = [one.start for one in task.handlings[retry.runs : retry.runs + 1]]
    starts += [one.start for one in task.queueings[queued : queued + 1]]
    return min(starts, default=task.time_of(END_ACHIEVING))


def _before_it_begins(
    monitor: Task, retry: Retry, children: list[Task], asker: Task | None
) -> list[Task]:
    """The tasks under a retried monitor until it begins anew. That is in no journal: it begins when
    nothing is under it any more, whoever asked has ended, and it is not suspended.
    """
    begins, found = retry.time, list[Task]()
    if asker is not None:
        begins = max(begins, asker.time_of(END_ACHIEVING))
    for child in children:
        for suspension in monitor.suspensions:
            if suspension.start <= begins:
                begins = max(begins, suspension.until)
        if child.received >= begins and bisect_left(monitor.children, child.id) >= retry.sent:
            break
        if not child.outlives_retry:
            begins = max(begins, child.time_of(END_ACHIEVING))
        found.append(child)
    return found


# --- as people are told ---------------------------------------------------------------------------


def waits_for_display(run: Run, task: Task, *, together: bool = False) -> list[Wait]:
    """The waits of a task for what came next in each of its states, oldest first. *together*: of
    subtasks that it waits for from one time on, the last that is named stands for the rest.
    """
    found: list[Wait] = []
    own = Overlaps(_of_task(run, task), _SPAN)
    handled = Overlaps(of_message(run, task), _SPAN)
    for place, (since, over, state) in enumerate(task.spans()):
        if state in OVER or over - since < NO_TIME:
            continue
        wanted, begun = _moments_in_state(task, state, since), begun_at(task, place)
        waits = [(one.start, one) for one in own.within(since, over)]
        for moment in (END_ACHIEVING, END_PLANNING):
            if moment & wanted:
                some = _subtasks(run, task, moment, (since, over), together=together)
                waits += ((run.tasks[one.on.number].received, one) for one in some)
        waits += ((one.start, one) for one in handled.within(since, over))
        for _, wait in sorted(waits, key=_SINCE):
            start, end = max(wait.start, since), min(wait.end, over)
            if wait.holds & wanted and end - start >= NO_TIME:
                of_all = min(begun, start) if is_of_state(wait, state) else start
                found.append(wait._replace(start=start, end=end, since=of_all))
    return sorted(found, key=_START)


def _moments_in_state(task: Task, state: TaskState, since: float) -> int:
    if state in (TaskState.SUSPENDED, TaskState.RECOVERING):
        return 0 if state is TaskState.SUSPENDED else STARTS | END_HANDLING
    return moments_before(task, next_moment(task, state, since), since)


def is_of_state(wait: Wait, state: TaskState) -> bool:
    """Whether something keeps a task since it is in its state, and not since the wait as such
    began.
    """
    return wait.kind in _OF_ITS_STATE or state is TaskState.ENDING


def begun_at(task: Task, place: int) -> float:
    """Since when a task waits that is in one of its states. It goes on with a wait after a
    suspension.
    """
    before = [task.stage(place)[1], TaskState.SUSPENDED]
    while place > 1 and [task.stage(place - 2)[1], task.stage(place - 1)[1]] == before:
        place -= 2
    return task.stage(place)[0]
