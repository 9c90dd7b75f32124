"""What a message or task waits for, one step on, as numbers: what waiting.py says in words. Asks what was known.

A task that is being planned may be waited for because it is not being achieved yet. That is another wait than the one
for the end of its planning, and leads elsewhere: its number is that of the task, negative.
"""

from collections.abc import Callable, Iterator
from enum import Enum

from tca_tools.records import Claim, Handling, Hold, Message, Queueing, State, Wait
from tca_tools.then import TaskThen, Then
from tca_tools.waiting import UNTIL_CHILDREN, blockers, blockers_of, watches
from tca_wire.points import ROOT, Moment, Point, TaskId


class Kind(Enum):
    """Why something waits for nothing else that has a number; those that come first are told first."""

    CIRCLE = 0  # it waits for itself, by way of others
    NOBODY = 1  # no module handles it
    SUSPENDED = 2
    STANDS = 3  # for something without a number, or for what the journal does not tell
    DELAYED = 4
    WATCHES = 5  # a monitor
    GOES_ON = 6  # its handler runs and waits for nothing


Lead = int | Kind


def leads(then: Then, number: int) -> tuple[list[int], Kind]:
    """The messages, tasks and locks that a message, task or lock waits for next; and what it is that waits for none."""
    if number < 0:
        found = list(_of_start(then, then.tasks[-number]))
    elif (claim := then.past.claims.get(number)) is not None:
        found = list(_of_held(then, claim))
    elif number in then.tasks:
        task = then.tasks[number]
        found = list(_OF_STATE[task.state](then, task)) if task.state in _OF_STATE else []
    else:
        found = list(_of_message(then, then.past.messages[number]))
    on = dict.fromkeys(one for one in found if isinstance(one, int))
    kinds = [one for one in found if isinstance(one, Kind)]
    return list(on), min(kinds, key=lambda kind: kind.value, default=Kind.STANDS)


def _of_held(then: Then, claim: Claim) -> Iterator[Lead]:
    """A lock in force waits for the handler, or else the task, for which it was wanted."""
    if claim.by is None:
        return
    wanted_by = claim.by.message_id
    goes_on = claim.by.end is None or claim.by.end > then.moment
    if goes_on or (wanted_by in then.tasks and Moment.END_ACHIEVING not in then.tasks[wanted_by].reached):
        yield wanted_by


def _of_message(then: Then, message: Message) -> Iterator[Lead]:
    """A message that is no task: a query, as a rule."""
    if queueing := then.queueing_of(message):
        yield from _of_place(then, message.id, message.sender, queueing)
    elif run := then.handling_of(message):
        yield from _of_run(then, run)


def _of_place(then: Then, number: int, sender: str, queueing: Queueing) -> Iterator[Lead]:
    """It is queued: for whom the resource is locked, or else what is handled there, or who waits to lock it."""
    module, resource = queueing.module, queueing.resource
    if not module:
        yield Kind.NOBODY
        return
    held_by = then.held_by(module, resource)
    if held_by and not (held_by.is_reserved and held_by.sender == sender):
        yield held_by.id
    elif busy := [run for run in then.running(module, resource) if run.message_id != number]:
        going_on = [run for run in busy if not any(then.waits_of(run))]  # the first that returns makes room
        yield from (run.message_id for run in going_on or busy)
    elif (wanted := then.wanted(module, resource)) and wanted.by and wanted.by.message_id != number:
        yield wanted.by.message_id


def _of_queued(then: Then, task: TaskThen) -> Iterator[Lead]:
    if task.queueing:
        yield from _of_place(then, task.id, task.sender, task.queueing)
    else:
        yield Kind.NOBODY


def _of_run(then: Then, run: Handling) -> Iterator[Lead]:
    """What a handler that blocks waits for."""
    for wait in then.waits_of(run):
        yield from _of_wait(then, wait, run.message_id)
    yield Kind.GOES_ON


def _of_wait(then: Then, wait: Wait, number: int) -> Iterator[Lead]:
    if wait.moment:
        if not then.has_reached(Point(TaskId(wait.awaited), wait.moment)):
            yield wait.awaited
    elif claim := then.past.claims.get(wait.awaited):
        held_by = then.held_by(claim.module, claim.resource)
        if held_by and held_by is not claim:
            yield held_by.id
        elif not held_by:
            yield from (
                one.message_id for one in then.running(claim.module, claim.resource) if one.message_id != number
            )
        yield Kind.STANDS
    elif (message := then.past.messages.get(wait.awaited)) and message.received <= then.moment:
        yield message.id


def _of_handled(then: Then, task: TaskThen) -> Iterator[Lead]:
    if run := task.handling:
        yield from _of_run(then, run)


def _of_held_back(then: Then, task: TaskThen) -> Iterator[Lead]:
    yield from _of_blockers(then, task, blockers(then, task))


def _of_start(then: Then, task: TaskThen) -> Iterator[Lead]:
    """What keeps a task that is being planned from being achieved."""
    moments = [Moment.START_ACHIEVING]
    yield from _of_blockers(then, task, blockers_of(then, task, moments))
    if len(moments) > 1:  # first it is to be planned
        yield int(task.id)


def _of_blockers(then: Then, task: TaskThen, found: Iterator[Hold | Moment]) -> Iterator[Lead]:
    for blocker in found:
        if isinstance(blocker, Moment):
            parent = then.tasks.get(task.parent)
            is_planned = parent is not None and parent.state is State.PLANNING
            yield -task.parent if is_planned and blocker is Moment.START_ACHIEVING else task.parent
            continue
        before = blocker.constraint.before
        is_delay = before.task == ROOT or (blocker.constraint.delay and then.has_reached(before))
        yield Kind.DELAYED if is_delay else before.task


def _of_children(then: Then, task: TaskThen, moment: Moment) -> Iterator[Lead]:
    yield from (child for child in task.children if moment not in then.tasks[child].reached)


def _of_expanding(then: Then, task: TaskThen) -> Iterator[Lead]:
    """A task that is being planned, or achieved."""
    if task.handling:
        yield from _of_handled(then, task)
    elif watches(task):
        yield Kind.WATCHES
    else:
        yield from _of_held_back(then, task)
        until = Moment.END_ACHIEVING if task.is_retried else UNTIL_CHILDREN[task.state]
        yield from _of_children(then, task, until)


def _of_suspension(task: TaskThen) -> Iterator[Lead]:
    if task.suspension:
        yield Kind.SUSPENDED if task.suspension.cause == task.id else task.suspension.cause


def _of_suspended(then: Then, task: TaskThen) -> Iterator[Lead]:
    """It waits for what was suspended above it, if that says so itself: it may be handled still."""
    cause = task.suspension.cause if task.suspension else task.id
    is_told_there = cause in then.tasks and then.tasks[cause].state is State.SUSPENDED
    yield cause if cause != task.id and is_told_there else Kind.SUSPENDED


def _of_recovering(then: Then, task: TaskThen) -> Iterator[Lead]:
    yield from (handler for handler in task.caught_by[-1:] if handler in then.tasks)
    if not task.handling:
        yield from _of_suspension(task)
    if task.queueing:
        yield from _of_queued(then, task)
    elif task.handling:
        yield from _of_handled(then, task) if task.wait else ()
    else:
        yield from _of_held_back(then, task)


def _of_ending(then: Then, task: TaskThen) -> Iterator[Lead]:
    yield from _of_handled(then, task)
    yield from _of_children(then, task, Moment.END_ACHIEVING)
    if not task.handling:
        yield from _of_suspension(task)


_OF_STATE: dict[State, Callable[[Then, TaskThen], Iterator[Lead]]] = {
    State.HELD: _of_held_back,
    State.SUSPENDED: _of_suspended,
    State.RECOVERING: _of_recovering,
    State.QUEUED: _of_queued,
    State.PLANNING: _of_expanding,
    State.PLANNED: _of_held_back,
    State.HANDLING: _of_handled,
    State.ACHIEVING: _of_expanding,
    State.ENDING: _of_ending,
}
