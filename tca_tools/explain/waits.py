"""The list of waits: for each task and message all its waits, read from its records.

- ``waits_of(run, number)``: all waits of a task or message. Each wait has one cause and one span.
  Waits may overlap and are not divided, so the size of all lists is linear in that of the journal.
- ``waits_for_display(run, task)``: the waits of a task to show, divided by the task's states.

graph.py has the waits at an instant; wait_words.py puts waits into words.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import inf
from operator import attrgetter, itemgetter
from typing import NamedTuple, TypeVar

from tca_tools.explain.deciding import decider
from tca_tools.explain.overlapping import cached, children_within, has_many
from tca_tools.journal.fates import watching_spans
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
)
from tca_tools.journal.sequences import active_at, newest_active
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
"""Waits that are shorter than this, in seconds, are not shown."""
_ENDS_WITH_CHILDREN = END_PLANNING | END_ACHIEVING
_OF_ORDER = {WaitKind.CONSTRAINT, WaitKind.PARENT, WaitKind.LISTENER, WaitKind.SUBTASK}
"""Waits for points of other tasks, caused by the order of tasks."""
_OF_ITS_STATE = _OF_ORDER | {WaitKind.DELAY}
"""Waits that count only from the start of a task's state. Others blocked it before."""

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
    """A node of the graph of waits: something that must happen."""

    number: int
    """The task, message or claim."""
    moment: int = 0
    """The moment to reach; 0 for a resume, an answer, or the grant or release of a claim."""
    delivery: int = 0
    """For a message to many receivers, the delivery that must be handled (0: all)."""


class Wait(NamedTuple):
    """One wait: its span, its kind, and the node that it is for."""

    start: float
    end: float
    """inf if it has not ended."""
    kind: WaitKind
    on: Node
    """The node that must come first; for a leaf, the cause itself."""
    blocks: int
    """The moments of the waiting task that it blocks, as bits."""
    record: Hold | Queueing | Handling | HandlerWait | Suspension | None = None
    """The record of the wait, if it is not just for a point of a task."""
    since: float = 0.0
    """The start of the uninterrupted waiting, for any causes; not after *start*."""
    others: Sequence[float] = ()
    """If this wait stands for other subtasks, too: when the waits for those end."""

    @property
    def is_leaf(self) -> bool:
        """Whether the wait is for no other node."""
        is_own = isinstance(self.record, Suspension) and self.record.cause == self.record.task
        is_any_change = self.kind is WaitKind.CHANGE and not self.on.number
        return self.kind in _LEAVES or is_own or is_any_change


def span_as_wait(
    record: Queueing | Handling | HandlerWait | Suspension, kind: WaitKind, on: Node, blocks: int
) -> Wait:
    """Return a wait with the span of its record."""
    return Wait(record.start, record.until, kind, on, blocks, record, record.start)


def has_come(run: Run, wait: HandlerWait) -> bool:
    """Whether the awaited moment or change of a task had come when a handler's wait ended.

    True if the wait was not for a known task.
    """
    task = run.tasks.get(wait.awaited)
    if task is None or wait.end is None:
        return task is None
    if wait.kind is WaitKind.CHANGE:
        return wait.end in task.times or any(one.time == wait.end for one in task.life or ())
    return wait.moment is None or task.time_of(wait.moment) <= wait.end


def node_of(run: Run, handling: Handling) -> Node:
    """Return the node for the return of a handler."""
    if handling.message_id in run.tasks:
        return Node(handling.message_id, END_HANDLING)
    is_one_of_many = handling.delivery != handling.message_id
    return Node(handling.message_id, 0, handling.delivery if is_one_of_many else 0)


# --- the moments of a task that matter at a time --------------------------------------------------

_UP_TO = [{0: 0, **rules.up_to} for rules in RULES]
"""Two tables: for commands, and for goals. By moment: the bits of the moments that a task reaches
before it or with it.
"""
_NEXT = {
    TaskState.HELD: START_HANDLING,
    TaskState.QUEUED: END_HANDLING,  # a retry; for the first handling see next_moment
    TaskState.PLANNING: END_PLANNING,
    TaskState.PLANNED: START_ACHIEVING,
    TaskState.HANDLING: END_HANDLING,
    TaskState.ACHIEVING: END_ACHIEVING,
    TaskState.RECOVERING: END_HANDLING,
    TaskState.SUSPENDED: 0,
    TaskState.ENDING: END_ACHIEVING,
}
"""The next moment of a task by state (0: it must be resumed)."""


def killed_at(task: Task) -> float:
    """Return when a task was killed; inf if it was not."""
    return inf if task.killed is None else task.written_at("killed")


def reached_moments(task: Task, time: float) -> int:
    """Return the moments that a task had reached, as bits."""
    bits = 0
    for moment, place in PLACES.items():
        bits |= moment if task.times[place] <= time else 0
    return bits


def next_moment(task: Task, state: TaskState, time: float) -> int:
    """Return the moment that a task in a state must reach next.

    A retried task may have reached END_HANDLING already. Then the next moment is END_ACHIEVING.
    """
    if state is TaskState.QUEUED and task.time_of(START_HANDLING) > time:
        return START_HANDLING
    moment = _NEXT.get(state, END_ACHIEVING)
    is_past = moment == END_HANDLING and task.time_of(END_HANDLING) <= time
    return END_ACHIEVING if is_past else moment


def moments_before(task: Task, moment: int, time: float) -> int:
    """Return the moments that a task must still reach, up to and including *moment*, as bits.

    A constraint between two moments of the task counts if the second one is among these moments.
    Then it adds the first one, and the moments before that.
    """
    if task.time_of(moment) <= time:
        # A task that is handled again, or will be, must end its handling once more
        is_again = active_at(task.handlings, time) or task.was_retry_due(time)
        return END_HANDLING if moment == END_HANDLING and is_again else 0
    if killed_at(task) <= time:  # a killed task waits for its handler only
        return END_HANDLING | (moment & ENDS)
    before = _UP_TO[task.message_class.is_goal]
    left = ~reached_moments(task, time)
    found = before[moment] & left
    known = (one.constraint for one in task.holds if one.added <= time)
    own = [one for one in known if one.before.task == task.id]
    for one in own * len(own):  # a constraint may add the moment that another one needs
        found |= before[one.before.moment] & left if one.after.moment & found else 0
    return found


def is_to_be_handled_again(task: Task, time: float) -> bool:
    """Whether a task's handler must still start, at first or again.

    True if it never started, if the last one was lost with its module, or if a retry is due.
    """
    begun = bisect_right(task.handlings, time, key=_START)
    if not begun:
        return True
    last = task.handlings[begun - 1]
    is_cut_off = last.outcome is None and last.end is not None and last.end <= time
    return is_cut_off or task.was_retry_due(time)


# --- all waits of one record ----------------------------------------------------------------------


def waits_of(run: Run, number: int) -> list[Wait]:
    """Return all waits of a task or message, oldest first; [] if it is unknown."""
    message = run.messages.get(number)
    if message is None:
        return []
    if isinstance(message, Task) and has_many(message):
        return cached(run, (waits_of, number), lambda: _all_waits(run, message))
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
    """Yield a message's waits in queues and in handlers; only those active at *time*, if given."""
    begun = message.time_of(START_HANDLING) if isinstance(message, Task) else -inf
    queueings = _active_spans(message.queueings, time, may_overlap=False)
    copies = _active_spans(run.copies.get(message.id, ()), time, may_overlap=True)
    for queueing in (*queueings, *copies):
        kind = WaitKind.RESOURCE if queueing.module else WaitKind.HANDLER
        blocks = START_HANDLING if begun > queueing.start else ENDS
        yield span_as_wait(queueing, kind, Node(message.id), blocks)
    # Only a task has one handler at a time
    may_overlap = not isinstance(message, Task)
    for handling in _active_spans(message.handlings, time, may_overlap=may_overlap):
        waits = handling.waits if time is None else newest_active(handling.waits, time)
        if time is None or not waits:
            yield span_as_wait(handling, WaitKind.RUNNING, node_of(run, handling), ENDS)
        yield from (of_handler_wait(run, wait) for wait in waits)


def _active_spans(
    spans: Sequence[_Span], time: float | None, *, may_overlap: bool
) -> Sequence[_Span]:
    """Return the spans active at *time*; all if that is None."""
    if time is None:
        return spans
    if may_overlap:
        return [one for one in spans if one.is_active(time)]
    last = active_at(spans, time)
    return [last] if last is not None else []


def of_handler_wait(run: Run, wait: HandlerWait) -> Wait:
    """Return the ``Wait`` of a handler or program."""
    kind = wait.kind
    if kind is WaitKind.TASK and not wait.moment:
        kind = WaitKind.LOCK if wait.awaited in run.claims else WaitKind.REPLY
    return span_as_wait(wait, kind, Node(wait.awaited, int(wait.moment or 0)), ENDS)


def _subtasks(
    run: Run, task: Task, moment: int, window: Span = _ALWAYS, *, together: bool = False
) -> Iterator[Wait]:
    """Yield the waits for a task's children, which block its planning or achievement.

    Args:
        run: The run.
        task: The waiting task.
        moment: END_PLANNING or END_ACHIEVING.
        window: The waits are cut to this span.
        together: Whether to yield only the first of the waits that start at one time; the last of
            them stands for the rest.
    """
    since, over = window
    last, number, begun = min(task.time_of(moment), over), 0, -inf
    others: list[float] = []
    children = children_within(run, task, moment, since, over)
    for child in blocking_tasks(run, children, moment, None):
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


def blocking_tasks(
    run: Run, children: Sequence[TaskId], moment: int, time: float | None
) -> list[Task]:
    """Return the tasks that block a moment of their parent at *time* (None: at any time).

    A monitor that ends with its siblings does not block its parent, unless a constraint blocks the
    monitor's end. Instead, the tasks that the monitor sent block the parent.
    """
    found: list[Task] = []
    rest = [*reversed(children)]
    while rest:
        child = run.tasks[rest.pop()]
        ends_with_siblings = child.message_class.is_interval_monitor and not child.is_waited_for
        if moment != END_ACHIEVING or not ends_with_siblings:
            found.append(child)
            continue
        if is_blocked := _is_blocked(run, child, time):
            found.append(child)
        if time is None:
            rest += reversed(child.children)
        elif not is_blocked:
            rest += reversed(children_within(run, child, moment, time, time))
    return found


def _is_blocked(run: Run, monitor: Task, time: float | None) -> bool:
    """Whether a constraint blocks a monitor's end.

    One on a retry's handling does not count. Nor does one on the same end of a child, since the
    monitor's parent waits for that child anyway, or not at all if the child only watches.
    """
    for hold in monitor.holds:
        for wait in _of_constraint(run, monitor, hold, killed_at(monitor)):
            is_active = time is None or wait.start <= time < wait.end
            is_of_end = wait.blocks in (END_HANDLING, END_ACHIEVING)
            is_by_child = run.tasks[wait.on.number].parent == monitor.id
            is_same_end = is_by_child and wait.on.moment == wait.blocks
            if is_active and is_of_end and not is_same_end and wait.kind is not WaitKind.DELAY:
                return True
    return False


def _of_task(run: Run, task: Task) -> Iterator[Wait]:
    """Yield the waits of a task, except in queues, in handlers, and for its children."""
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
    # Two retries before the next handling cause one wait
    again: dict[object, Wait] = {}
    until = killed
    for retry in reversed(task.retries):
        until = min(until, retry.replaced)
        for wait in _of_retry(run, task, retry, until):
            again[wait.on, wait.end] = wait
    found += again.values()
    if task.caught_by or task.is_recovering or task.changes:
        found += _of_recovery(run, task)
    if task.message_class.is_monitor:
        found += [
            Wait(*span, WaitKind.CONDITION, Node(task.id), ENDS) for span in watching_spans(task)
        ]
    return (wait for wait in found if wait.start < wait.end)


def own_waits(run: Run, task: Task, start: float, end: float) -> Iterable[Wait]:
    """Return a task's own waits that are active in a span; all its waits if it has few records."""
    if not has_many(task):
        return _of_task(run, task)
    known = cached(run, (own_waits, task.id), lambda: Overlaps(_of_task(run, task), _SPAN))
    return known.within(start, end)


def _of_constraint(run: Run, task: Task, hold: Hold, killed: float) -> Iterator[Wait]:
    """Yield the waits of a constraint: until its point is reached, and until its delay is over.

    A constraint between two moments of one task is no wait: the waits before the first moment count
    for the second, too (see ``moments_before``). Nor is one on a child's end: the task waits for
    that end anyway, as for a subtask, or not at all if the child only watches.
    """
    before, moment = hold.constraint.before, int(hold.constraint.after.moment)
    # A listener or a pause may hold a task that has reached the moment and is handled again
    is_again = task.time_of(moment) < hold.added
    last = min(task.time_of(END_ACHIEVING if is_again else moment), killed)
    other, met = run.tasks.get(before.task), -inf
    if other is not None:
        met = other.time_of(before.moment)
    blocks = ENDS if is_again else moment
    is_child_end = moment & _ENDS_WITH_CHILDREN and before.moment == moment
    is_awaited = other is not None and other.parent == task.id and is_child_end
    if other is not None and other is not task and not is_awaited:
        kind = WaitKind.LISTENER if hold.tap else WaitKind.CONSTRAINT
        on = Node(other.id, int(before.moment))
        yield Wait(hold.added, min(met, last), kind, on, blocks, hold)
    if hold.constraint.delay:
        start, end = max(met, hold.added), min(hold.over, last)
        yield Wait(start, end, WaitKind.DELAY, Node(task.id), blocks, hold)


def _of_suspension(task: Task, suspension: Suspension) -> Wait:
    """Return the wait of a suspended task: it neither starts an interval nor is handled again."""
    start = suspension.start
    blocks = _UP_TO[task.message_class.is_goal][START_ACHIEVING] & ~reached_moments(task, start)
    if not blocks and is_to_be_handled_again(task, start):
        blocks = ENDS
    return span_as_wait(suspension, WaitKind.RESUME, Node(suspension.cause), blocks)


def _of_recovery(run: Run, task: Task) -> Iterator[Wait]:
    """Yield the waits for exception handlers.

    The waits for handlers of the task's own failures follow one another. The waits for handlers of
    failures raised from outside the task's handler may overlap with these and with each other.
    """
    called = [run.tasks[number] for number in task.caught_by if number in run.tasks]
    known = [run.tasks[number] for number in task.deciders if number in run.tasks]
    until = {one.id: later.received for one, later in pairwise(known)}
    waits = []
    for one in called:
        on, end = Node(one.id, END_ACHIEVING), one.time_of(END_ACHIEVING)
        end = min(until.get(one.id, inf), end)
        waits.append(Wait(one.received, end, WaitKind.RECOVERY, on, ENDS))
    if not called:  # the journal starts later
        waits = [Wait(-inf, inf, WaitKind.RECOVERY, Node(0), ENDS)]
    deciding = Overlaps(waits, _SPAN)
    for since, over, state in task.spans():
        if state is TaskState.RECOVERING:
            for wait in deciding.within(since, over):
                start, end = max(since, wait.start), min(over, wait.end)
                yield wait._replace(start=start, end=end)


# --- retries --------------------------------------------------------------------------------------


def _of_retry(run: Run, task: Task, retry: Retry, until: float) -> Iterator[Wait]:
    """Yield a retried task's waits until its descendants have ended and it is handled again.

    It is not handled again if it is killed or replaced first, at *until*.
    """
    if task.time_of(START_HANDLING) >= retry.time:
        return
    begun = _start_after(task, retry)
    over = min(begun, until)
    asker = decider(run, retry.asker)
    if asker is not None:
        end, on = min(asker.time_of(END_ACHIEVING), over), Node(asker.id, END_ACHIEVING)
        yield Wait(retry.time, end, WaitKind.RECOVERY, on, ENDS)
    numbers = children_within(run, task, END_ACHIEVING, retry.time, begun)
    children = [run.tasks[number] for number in numbers]
    if task.message_class.is_monitor:
        children = _before_restart(task, retry, children, asker)
    awaited = [TaskId(child.id) for child in children if not child.outlives_retry]
    for child in blocking_tasks(run, awaited, END_ACHIEVING, retry.time):
        if child is not asker:
            start, on = max(retry.time, child.received), Node(child.id, END_ACHIEVING)
            end = min(child.time_of(END_ACHIEVING), over)
            yield Wait(start, end, WaitKind.SUBTASK, on, ENDS)


def _start_after(task: Task, retry: Retry) -> float:
    """Return when a retried task was queued or handled, else when it ended."""
    queued = bisect_left(task.queueings, retry.time, key=_START)
    starts = [one.start for one in task.handlings[retry.handlings : retry.handlings + 1]]
    starts += [one.start for one in task.queueings[queued : queued + 1]]
    return min(starts, default=task.time_of(END_ACHIEVING))


def _before_restart(
    monitor: Task, retry: Retry, children: list[Task], asker: Task | None
) -> list[Task]:
    """Return the children of a retried monitor that were sent before it restarted.

    The journal has no fact for the restart. A monitor restarts once its children and the asker
    have ended and it is not suspended.
    """
    restart, found = retry.time, list[Task]()
    held = [one.constraint for one in monitor.holds]
    listeners = {one.before.task for one in held if one.after.moment == START_HANDLING}
    if asker is not None:
        restart = max(restart, asker.time_of(END_ACHIEVING))
    for child in children:
        for suspension in monitor.suspensions:
            if suspension.start <= restart:
                restart = max(restart, suspension.until)
        is_later = bisect_left(monitor.children, child.id) >= retry.children
        if child.received >= restart and is_later and child.id not in listeners:
            break
        if not child.outlives_retry:
            restart = max(restart, child.time_of(END_ACHIEVING))
        found.append(child)
    return found


# --- waits for display ----------------------------------------------------------------------------


def waits_for_display(run: Run, task: Task, *, together: bool = False) -> list[Wait]:
    """Return the waits of a task for its next moment in each of its states, oldest first.

    Args:
        run: The run.
        task: The task.
        together: Whether to name only the first subtasks awaited since the same time; the last
            of these waits stands for the rest.
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
                subtasks = _subtasks(run, task, moment, (since, over), together=together)
                waits += ((run.tasks[one.on.number].received, one) for one in subtasks)
        waits += ((one.start, one) for one in handled.within(since, over))
        for _, wait in sorted(waits, key=_SINCE):
            start, end = max(wait.start, since), min(wait.end, over)
            if wait.blocks & wanted and end - start >= NO_TIME:
                waiting_since = min(begun, start) if is_of_state(wait, state) else start
                found.append(wait._replace(start=start, end=end, since=waiting_since))
    return sorted(found, key=_START)


def _moments_in_state(task: Task, state: TaskState, since: float) -> int:
    if state in (TaskState.SUSPENDED, TaskState.RECOVERING):
        return 0 if state is TaskState.SUSPENDED else STARTS | END_HANDLING
    return moments_before(task, next_moment(task, state, since), since)


def is_of_state(wait: Wait, state: TaskState) -> bool:
    """Whether a wait counts from the start of the task's state, not from its own start."""
    return wait.kind in _OF_ITS_STATE or state is TaskState.ENDING


def begun_at(task: Task, place: int) -> float:
    """Return since when a task has been waiting in one of its states.

    A state that continues after a suspension counts from before the suspension.
    """
    before = [task.stage(place)[1], TaskState.SUSPENDED]
    while place > 1 and [task.stage(place - 2)[1], task.stage(place - 1)[1]] == before:
        place -= 2
    return task.stage(place)[0]
