"""What is waited for next, one step on, as numbers: what waiting.py says in words. Asks what was known.

Who waits for a task waits until it reaches a moment, and which one that is decides where it leads: what is planned
ahead is kept from being planned by one thing, and from being achieved by another. So a step goes from moment to moment.
"""

from bisect import bisect_right
from collections.abc import Iterator
from enum import Enum
from operator import attrgetter
from typing import NamedTuple

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import OVER, Claim, HandlerWait, Handling, Hold, Message, Queueing, State
from tca_tools.why.waiting import blockers_of, up_to
from tca_tools.why.whereabouts import ahead_of_claim, kept_out
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


class Node(NamedTuple):
    """Something that is waited for."""

    number: int
    """The task, message or lock."""
    moment: Moment | None = None
    """What the task is to reach (None: it is to be resumed); None of a message that is to be answered, and of a lock
    that is to be granted or, if it was, to be over.
    """
    delivery: int = 0
    """Of what was sent to many: the one of them that is to be handled (0: all)."""


Lead = Node | Kind

_ENDS = {Moment.END_HANDLING, Moment.END_PLANNING, Moment.END_ACHIEVING}
"""The moments that a task reaches only after its handler has returned."""
_NEXT = {
    State.HELD: Moment.START_HANDLING,
    State.QUEUED: Moment.END_HANDLING,  # once more
    State.PLANNING: Moment.END_PLANNING,
    State.PLANNED: Moment.START_ACHIEVING,
    State.HANDLING: Moment.END_HANDLING,
    State.ACHIEVING: Moment.END_ACHIEVING,
    State.RECOVERING: Moment.END_HANDLING,
    State.SUSPENDED: None,
    State.ENDING: Moment.END_ACHIEVING,
}
"""The moment that a task waits for itself."""


def next_of(at: RunAt, number: int) -> Node:
    """What a task, message or lock comes to next."""
    if number not in at.tasks:
        return Node(number)
    task = at.tasks[number]
    if (task.handling or task.watches) and task.state is not State.ENDING:
        return Node(number, Moment.END_HANDLING)
    is_first = task.state is State.QUEUED and Moment.START_HANDLING not in task.reached
    return Node(number, Moment.START_HANDLING if is_first else _NEXT.get(task.state, Moment.END_ACHIEVING))


def leads(at: RunAt, node: Node) -> tuple[list[Node], list[Kind]]:
    """All that this waits for next; and why it waits for itself, where that is so."""
    found: list[Lead] = []
    if (claim := at.run.claims.get(node.number)) is not None:
        found += _of_claim(at, claim)
    elif node.number in at.tasks:
        task = at.tasks[node.number]
        found += _of_suspension(task) if node.moment is None else _of_moment(at, task, node.moment)
    elif message := at.run.messages.get(node.number):
        found += _of_message(at, message, node.delivery)
    on = dict.fromkeys(one for one in found if isinstance(one, Node))
    kinds = dict.fromkeys(one for one in found if isinstance(one, Kind))
    return list(on), list(kinds) if on or kinds else [Kind.STANDS]


# --- locks, messages and handlers ----------------------------------------------------------------------------------


def _of_claim(at: RunAt, claim: Claim) -> Iterator[Lead]:
    if at.is_granted(claim):
        yield from _of_held(at, claim)
    elif held_by := at.held_by(claim.module, claim.resource):
        yield Node(held_by.id)
    else:
        inside, first = ahead_of_claim(at, claim)
        yield from (_of_handler(at, run) for run in inside)
        if first:
            yield Node(first.id)


def _of_held(at: RunAt, claim: Claim) -> Iterator[Lead]:
    """A lock in force waits for the handler, or else the task, for which it was wanted; of a retried one until that is
    handled again. Outside of handlers it waits for what its module waits for there.
    """
    if claim.by is None:
        for wait in at.waits_outside(claim.sender):
            yield from _of_wait(at, wait)
        return
    task = at.tasks.get(claim.by.message_id)
    if claim.by.end is None or claim.by.end > at.moment:
        yield _of_handler(at, claim.by)
    elif task is not None and task.state not in OVER:
        yield Node(task.id, Moment.END_HANDLING if task.is_retried else Moment.END_ACHIEVING)


def _of_handler(at: RunAt, run: Handling) -> Node:
    if run.message_id in at.tasks:
        return Node(run.message_id, Moment.END_HANDLING)
    return Node(run.message_id, None, run.delivery if run.delivery != run.message_id else 0)


def _of_message(at: RunAt, message: Message, delivery: int) -> Iterator[Lead]:
    """A message that is no task: a query, as a rule."""
    if message.message_class.asks_many:
        runs, copies = at.copies_of(message)
        for one in runs:
            if delivery in (0, one.delivery):
                yield from _of_run(at, one)
        for copy in copies if not delivery else ():
            yield from _of_place(at, message, copy)
    elif queueing := at.queueing_of(message):
        yield from _of_place(at, message, queueing)
    elif run := at.handling_of(message):
        yield from _of_run(at, run)


def _of_place(at: RunAt, message: Message | TaskAt, queueing: Queueing) -> Iterator[Lead]:
    """It is queued: what keeps it out of the resource."""
    if not queueing.module:
        yield Kind.NOBODY
        return
    by = kept_out(at, queueing.module, queueing.resource, message)
    if isinstance(by, Claim):
        yield Node(by.id)
    else:
        going_on = [run for run in by if not any(at.waits_of(run))]  # the first that returns makes room
        yield from (_of_handler(at, run) for run in going_on or by)


def _of_run(at: RunAt, run: Handling) -> Iterator[Lead]:
    """What a handler that blocks waits for."""
    waits = at.waits_of(run)
    for wait in waits:
        yield from _of_wait(at, wait)
    if not waits:
        yield Kind.GOES_ON


def _of_wait(at: RunAt, wait: HandlerWait) -> Iterator[Lead]:
    if wait.moment:
        if not at.has_reached(Point(TaskId(wait.awaited), wait.moment)):
            yield Node(wait.awaited, wait.moment)
    elif wait.awaited in at.run.claims:
        yield Node(wait.awaited)
    elif (message := at.run.messages.get(wait.awaited)) and message.received <= at.moment:
        yield next_of(at, message.id)


# --- tasks ---------------------------------------------------------------------------------------------------------


def _of_moment(at: RunAt, task: TaskAt, moment: Moment) -> Iterator[Lead]:
    """What keeps a task from a moment that it has not reached."""
    state = task.state
    if state in OVER:
        return
    if state is State.ENDING:
        yield from _of_killed(at, task, moment)
        return
    moments = up_to(task, moment)
    found = list(_of_blockers(at, task, moments))  # there may be more moments now
    is_end = moment in _ENDS or not _ENDS.isdisjoint(moments)
    if is_end and state is State.RECOVERING:
        yield from (Node(one, Moment.END_ACHIEVING) for one in task.caught_by[-1:] if one in at.tasks)
    if is_end and (task.handling or task.watches):
        yield from _of_run(at, task.handling) if task.handling else [Kind.WATCHES]
        if moment is Moment.END_HANDLING:
            return  # the rest comes later
    elif is_end or Moment.START_HANDLING in moments:
        yield from _of_beginning(at, task)
    yield from found
    if until := _until(task, moments, is_end=is_end):
        yield from (Node(child, until) for child in task.children if not at.has_reached(Point(child, until)))


def _of_beginning(at: RunAt, task: TaskAt) -> Iterator[Lead]:
    """What keeps a task from its handler, beside constraints."""
    if task.queueing:
        yield from _of_place(at, task, task.queueing)
        return
    if task.is_retried or _has_no_handler(at, task):
        yield from _of_suspension(task)


def _has_no_handler(at: RunAt, task: TaskAt) -> bool:
    """Whether it has had none, or the last one left before it returned."""
    runs = at.run.tasks[task.id].handlings
    begun = bisect_right(runs, at.moment, key=attrgetter("start"))
    return not begun or runs[begun - 1].outcome is None


def _until(task: TaskAt, moments: list[Moment], *, is_end: bool) -> Moment | None:
    """What all under a task has to reach first."""
    if Moment.END_ACHIEVING in moments or (task.is_retried and is_end):
        return Moment.END_ACHIEVING
    return Moment.END_PLANNING if Moment.END_PLANNING in moments else None


def _of_blockers(at: RunAt, task: TaskAt, moments: list[Moment]) -> Iterator[Lead]:
    for blocker in blockers_of(at, task, moments):
        if is_delay(at, blocker):
            yield Kind.DELAYED
        elif isinstance(blocker, Moment):
            yield Node(task.parent, blocker)
        else:
            yield Node(blocker.constraint.before.task, blocker.constraint.before.moment)


def is_delay(at: RunAt, blocker: Hold | Moment) -> bool:
    """Whether only time has to pass."""
    if isinstance(blocker, Moment):
        return False
    before = blocker.constraint.before
    return before.task == ROOT or (blocker.constraint.delay > 0 and at.has_reached(before))


def _of_suspension(task: TaskAt) -> Iterator[Lead]:
    if task.suspension:
        yield Kind.SUSPENDED if task.suspension.cause == task.id else Node(task.suspension.cause)


def _of_killed(at: RunAt, task: TaskAt, moment: Moment) -> Iterator[Lead]:
    """A killed task waits for its handler, and for what leaves things safe; for no constraint."""
    if task.handling:
        yield from _of_run(at, task.handling)
    if moment in (Moment.END_PLANNING, Moment.END_ACHIEVING):
        yield from (Node(child, moment) for child in task.children if not at.has_reached(Point(child, moment)))
