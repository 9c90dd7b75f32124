"""What became of a failure, and whether the run went on after it. All tools ask here.

A task's failure is followed through the task's states. Of a query that fails the sender is told; what he makes of it,
the facts show: his handler ends well, or fails too, and then it depends on what became of that. A program outside of
any handler is told, and nothing fails with it. Pure; each step is O(log) of what happened to one message.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from enum import StrEnum
from math import inf
from operator import attrgetter, itemgetter

from tca_tools.past import Past
from tca_tools.records import Handling, Message, State, Task
from tca_wire.vocabulary import Outcome, Role

_SINCE, _START = itemgetter(0), attrgetter("start")
_UNDECIDED = (State.RECOVERING, State.ENDING, State.FAILED)
"""States in which a failure leaves its task first; what comes after them decides."""

HANDLED = "failed (handled)"
"""How a task stands that has failed, if the run went on after that."""
STANDINGS = tuple(word for state in State for word in ((state, HANDLED) if state is State.FAILED else (state,)))
"""All words for how a task stands, in the order in which they are listed."""

Failing = Message | Handling
"""What fails: a message; or the run of a handler, of what is no message that central knows."""


class Fate(StrEnum):
    """What became of a failure."""

    RETRIED = "retried"
    DEALT_WITH = "dealt with"
    REPLACED = "replaced"  # the task was killed, and in the end the top-level task was achieved without it
    KILLED = "killed"  # an exception handler was called, and the task was killed
    NOT_HANDLED = "not handled"  # no exception handler was found
    COPED = "told to the asker, who went on"  # of a query
    TOLD = "told to the asker"  # a program outside of handlers: with that nothing fails
    ANSWERED = "told to the asker, who failed"  # and nobody handled that
    UNTOLD = "told to nobody"  # of an inform or the like
    OPEN = "open"  # not decided when the journal ended


GOOD_FATES = (Fate.RETRIED, Fate.DEALT_WITH, Fate.REPLACED, Fate.COPED, Fate.TOLD)
"""After these the robot went on, as far as the journal tells."""
ENDED_TASKS = (Fate.REPLACED, Fate.KILLED, Fate.NOT_HANDLED)
"""With these the task that failed came to its end."""


def fate(past: Past, failed: Failing, time: float) -> Fate:
    """What became of a failure at *time*, as far as the records go."""
    if isinstance(failed, Task):
        return _of_task(past, failed, time)
    if not _has_asker(past, failed):
        return Fate.UNTOLD
    if failed.by is None and _monitor(past, failed) is None:
        return Fate.TOLD
    return Fate.COPED if went_on(past, failed, time) else Fate.ANSWERED


def went_on(past: Past, failed: Failing, time: float, known: float = inf) -> bool:
    """Whether the run went on, or still may, after what failed at *time*; as far as that was known at a moment."""
    *_, (last, when) = _passed_on(past, failed, time, known)
    if isinstance(last, Task):
        return _has_failed(last, known) and _of_task(past, last, when, known) in (*GOOD_FATES, Fate.OPEN)
    return _has_asker(past, last)


def coped_with(past: Past, message: Message, moment: float = inf) -> bool:
    """Whether a message had failed at a moment, and the run went on after that, or still may."""
    return bool(message.was("failure", moment)) and went_on(past, message, message.written("failure", moment))


def standing(past: Past, task: Task, state: State, moment: float = inf) -> str:
    """How a task in a state stands at a moment: that, and of a failure whether the run went on after it."""
    return HANDLED if state is State.FAILED and coped_with(past, task, moment) else str(state)


def has_coped(past: Past, handling: Handling) -> bool:
    """The same of the run of a handler that failed."""
    return handling.end is not None and went_on(past, failing(past, handling), handling.end)


def failing(past: Past, handling: Handling) -> Failing:
    """What has failed if the run of a handler has: its message, unless that came directly."""
    return past.messages.get(handling.message_id) or handling


def hinges(past: Past, failed: Failing, time: float) -> list[tuple[Task | Handling, bool]]:
    """What may still change whether the run went on: when this changes or (True) is over. Nothing: that is settled."""
    *_, (last, when) = _passed_on(past, failed, time)
    if not isinstance(last, Task):
        return [(last.by, False)] if last.by is not None and last.by.end is None else []
    if _of_task(past, last, when) in (Fate.RETRIED, Fate.DEALT_WITH, Fate.REPLACED):
        return []
    top = past.tasks[last.top]
    return [(last, False), (top, True)]


def told_to(past: Past, failed: Failing, time: float, known: float = inf) -> str:
    """Who is told of the failure of a query, and what came of it: "told to chef, who went on"; as far as that was known
    at a moment.
    """
    if not _has_asker(past, failed):
        return ""
    if isinstance(failed, Message) and failed.role is Role.CONDITION:
        return f"told to central, for {past.describe(failed.about)}"
    sender = failed.sender if isinstance(failed, Message) else failed.direct_from
    if failed.by is None:
        return f"told to {sender}"
    asker = past.describe(failed.by.message_id)
    if failed.by.end is None or failed.by.end > known:
        return f"told to {sender}, whose handler of {asker} still runs"
    if failed.by.outcome is not Outcome.FAILED:
        return f"told to {sender}, whose handler of {asker} went on"
    after = ", and that was handled" if went_on(past, failed, time, known) else ""
    return f"told to {sender}, whose handler of {asker} failed then{after}"


def _passed_on(past: Past, failed: Failing, time: float, known: float = inf) -> Iterator[tuple[Failing, float]]:
    """What failed, and what failed with it, when: as far as a task, or who was told and did not fail."""
    while True:
        yield failed, time
        if isinstance(failed, Task):
            return
        run = failed.by
        if monitor := _monitor(past, failed):
            failed = monitor
        elif (
            run is not None and run.outcome is Outcome.FAILED and (run.end or 0.0) <= known and _has_asker(past, failed)
        ):
            failed, time = failing(past, run), run.end or time  # older than what it asked, so this ends
        else:
            return


def _has_asker(past: Past, failed: Failing) -> bool:
    """Whether somebody is told."""
    if isinstance(failed, Message):
        return failed.message_class.has_reply
    known = past.formats.get(failed.name)
    return known is not None and known.message_class.has_reply


def _monitor(past: Past, failed: Failing) -> Task | None:
    """The monitor whose condition it is."""
    return past.tasks.get(failed.about) if isinstance(failed, Message) and failed.role is Role.CONDITION else None


def _has_failed(task: Task, known: float) -> bool:
    return any(name == "failure" and time <= known for time, name, _ in task.changes)


def _place(task: Task, time: float) -> int:
    """Which of its states a task was in."""
    return max(bisect_right(task.states, time, key=_SINCE) - 1, 0)


def _of_task(past: Past, task: Task, time: float, known: float = inf) -> Fate:
    """By the first state that decides: killed, or one in which the task goes on, or has ended well."""
    first, last = _place(task, time), _place(task, known)
    decided = next((place for place in range(first, last + 1) if task.states[place][1] not in _UNDECIDED), None)
    if decided is None and task.states[last][1] is State.RECOVERING:
        return Fate.OPEN
    if decided is not None and task.states[decided][1] is not State.KILLED:
        if _was_begun_again(task, time, task.states[decided][0]):
            return Fate.RETRIED
        if time not in past.unhandled.get(task.id, ()):  # what survives what is above it goes on, though it has failed
            return Fate.DEALT_WITH
    top = past.tasks[task.top]
    if top is not task and top.states[_place(top, known)][1] is State.ACHIEVED:
        return Fate.REPLACED
    called = (past.tasks[one].received for one in reversed(task.caught_by) if one in past.tasks)
    newest = next((when for when in called if when <= known), None)
    return Fate.KILLED if newest is not None and newest >= time else Fate.NOT_HANDLED


def _was_begun_again(task: Task, time: float, end: float) -> bool:
    """Whether it was to be handled again, or was, after *time* and until *end*."""
    again = task.retries[bisect_right(task.retries, time, key=_SINCE) :][:1]
    runs = task.handlings[bisect_left(task.handlings, time, key=_START) :][:1]
    return any(when <= end for when in (*(one[0] for one in again), *(run.start for run in runs)))
