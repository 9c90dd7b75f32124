"""The failures of a run, the fate of each, and whether the run went on after it. All tools ask
here.

A task's failure is followed through the task's states. Of a query that fails the sender is told;
what he makes of it, the facts show: his handler ends well, or fails too, and then it depends on
what became of that. A program outside of any handler is told, and nothing fails with it. Who had
given up or ended before is not told, and nothing of his fails with it. Pure; each step is O(log) of
what happened to one message.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from enum import StrEnum
from itertools import pairwise
from math import inf
from operator import attrgetter, itemgetter
from typing import NamedTuple

from tca_tools.journal.records import (
    DONE,
    NO_FAILURE,
    OVER,
    Failure,
    Handling,
    Message,
    Task,
    TaskState,
)
from tca_tools.journal.whole_run import Run
from tca_wire.points import Moment
from tca_wire.vocabulary import CENTRAL, Outcome, Role

_SINCE, _START, _TIME = itemgetter(0), attrgetter("start"), attrgetter("time")
UNDECIDED = (TaskState.RECOVERING, TaskState.ENDING, TaskState.FAILED)
"""States in which a failure leaves its task first; what comes after them decides."""

HANDLED = "failed (handled)"
"""How a task stands that has failed, if the run went on after that."""
WATCHING = "watching"
"""How a monitor stands that has begun to watch, and goes on: as a task it is being achieved."""
_MORE = {TaskState.FAILED: HANDLED, TaskState.ACHIEVING: WATCHING}
STANDINGS = tuple(
    word for state in TaskState for word in ((state, _MORE[state]) if state in _MORE else (state,))
)
"""All words for how a task stands, in the order in which they are listed."""

Failing = Message | Handling
"""Something that fails: a message; or the run of a handler of a message that central does not
know.
"""


class Fate(StrEnum):
    """The fate of a failure."""

    RETRIED = "retried"  # itself; or a task above it, for which it was killed
    DEALT_WITH = "recovered"
    REPLACED = "replaced"  # the task was killed, and the top-level task went on without it, or was achieved
    KILLED = "killed"  # the task was killed, and with it, or by its exception handler, the top-level task
    NOT_HANDLED = "unhandled"  # no exception handler was found
    COPED = "coped"  # of a query: whoever asked was told, and went on
    TOLD = "told"  # of a query of a program outside of handlers: with that nothing fails
    ANSWERED = "passed"  # of a query: whoever asked was told, and failed, and nobody handled that
    UNTOLD = "untold"  # of an inform or the like; of a query that its sender no longer waited for
    OPEN = "open"  # not decided when the journal ended

    @property
    def words(self) -> str:
        """As people are told of it."""
        return _WORDS.get(self, self.value)


_WORDS = {
    Fate.DEALT_WITH: "dealt with",
    Fate.NOT_HANDLED: "not handled",
    Fate.COPED: "told to the asker, who went on",
    Fate.TOLD: "told to the asker",
    Fate.ANSWERED: "told to the asker, who failed",
    Fate.UNTOLD: "told to nobody",
}

GOOD_FATES = (Fate.RETRIED, Fate.DEALT_WITH, Fate.REPLACED, Fate.COPED, Fate.TOLD)
"""After these the robot went on, as far as the journal tells."""
ENDED_TASKS = (Fate.REPLACED, Fate.KILLED, Fate.NOT_HANDLED)
"""With these the task that failed came to its end."""


def fate(run: Run, failed: Failing, time: float, known: float = inf) -> Fate:
    """The fate of a failure at *time*, as far as the records go, or as far as it was known at a
    moment.
    """
    if isinstance(failed, Task):
        return _of_task(run, failed, time, known)
    if not is_reported(run, failed, time):
        return Fate.UNTOLD
    if failed.by is None and _monitor(run, failed) is None:
        return Fate.TOLD
    return Fate.COPED if run_continued(run, failed, time, known) else Fate.ANSWERED


def run_continued(run: Run, failed: Failing, time: float, known: float = inf) -> bool:
    """Whether the run went on, or still may, after what failed at *time*; as far as that was known
    at a moment.
    """
    *_, (last, when) = _passed_on(run, failed, time, known)
    if isinstance(last, Task):
        has_failed = any(since <= known for since, _ in last.overwritten("failure")[:1])
        return has_failed and _of_task(run, last, when, known) in (*GOOD_FATES, Fate.OPEN)
    return is_reported(run, last, when)


def is_reported(run: Run, failed: Failing, time: float) -> bool:
    """Whether somebody is told of what is no task and failed at *time*: who asked, if he still
    waited for an answer.
    """
    return _has_asker(run, failed) and not _why_untold(run, failed, time)


def has_run_survived(
    run: Run, message: Message, moment: float = inf, known: float | None = None
) -> bool:
    """Whether a message had failed at a moment, and the run had gone on after that by then, or
    still might; or had by the moment until which things are *known*.
    """
    failed = message.written("failure", moment)
    return bool(message.was("failure", moment)) and run_continued(
        run, message, failed, moment if known is None else known
    )


def standing(run: Run, task: Task, state: TaskState, moment: float = inf) -> str:
    """How a task in a state stands at a moment, in words; see ``STANDINGS``."""
    if watches(task, state, moment):
        return WATCHING
    return (
        HANDLED if state is TaskState.FAILED and has_run_survived(run, task, moment) else str(state)
    )


def watches(task: Task, state: TaskState, moment: float = inf) -> bool:
    """Whether it is a monitor that has begun to watch, and goes on."""
    if state not in (TaskState.ACHIEVING, TaskState.PLANNING) or not task.message_class.is_monitor:
        return False
    if task.time_of(Moment.START_HANDLING) > moment:
        return False
    place = bisect_right(task.retries, moment, key=_SINCE)
    retried = task.retries[place - 1].time if place else 0.0  # it begins anew
    return not task.was("watched", moment) or retried >= task.written("watched", moment)


def watching(task: Task) -> Iterator[tuple[float, float]]:
    """From when until when a monitor watched: while it was being achieved, from its beginning, or
    its retry, on.
    """
    begun, spans = task.time_of(Moment.START_HANDLING), list[tuple[float, float]]()
    for stopped in (time for time, why in task.became("watched") if why):
        spans.append((begun, stopped))
        begun = min((one.time for one in task.retries if one.time >= stopped), default=inf)
    spans.append((begun, inf))
    for since, over, state in task.spans():
        for start, end in spans if state in (TaskState.ACHIEVING, TaskState.PLANNING) else ():
            if max(start, since) < min(end, over):
                yield max(start, since), min(end, over)


def run_continued_after(run: Run, handling: Handling) -> bool:
    """Whether the run went on after a handler failed."""
    return handling.end is not None and run_continued(run, failing(run, handling), handling.end)


def failing(run: Run, handling: Handling) -> Failing:
    """The message that failed with the run of its handler, or the run itself for a direct
    message.
    """
    return run.messages.get(handling.message_id) or handling


def undecided_by(run: Run, failed: Failing, time: float) -> list[Task | Handling]:
    """The tasks and handlers on which it still depends whether the run went on. Empty: that is
    settled.
    """
    *_, (last, when) = _passed_on(run, failed, time)
    if not isinstance(last, Task):
        is_open = last.by is not None and last.by.end is None and is_reported(run, last, when)
        return [last.by] if is_open and last.by is not None else []
    became, top = _of_task(run, last, when), run.tasks[last.top]
    handler = _last_called(run, last, when, inf)
    is_through = top.state in DONE or (handler is not None and handler.has_ended)
    if became in (Fate.RETRIED, Fate.DEALT_WITH) or (became is Fate.REPLACED and is_through):
        return []
    return [last, top]


def retried_ancestor(run: Run, task: Task, time: float, known: float = inf) -> Task | None:
    """The task above one that failed at *time* with whose retry it was killed; as far as that was
    known at a moment.
    """
    killed = task.written("killed", known)
    if task.was("killed", known) is None or killed < time:
        return None
    while task.parent in run.tasks:  # what is between them was killed with it
        task = run.tasks[task.parent]
        place = bisect_left(task.retries, killed, key=_SINCE)
        if task.retries[place : place + 1] and task.retries[place][0] == killed:
            return task
        if task.killed is None or task.written("killed") != killed:
            return None
    return None


def describe_asker(run: Run, failed: Failing, time: float, known: float = inf) -> str:
    """The asker that is told of a failed query, and its fate by a moment; or why nobody is told."""
    if not _has_asker(run, failed):
        return ""
    if why := _why_untold(run, failed, time):
        return f"{Fate.UNTOLD.words}: {why}"
    if isinstance(failed, Message) and failed.role is Role.CONDITION:
        return f"told to central, for {run.describe(failed.about)}"
    sender = failed.sender if isinstance(failed, Message) else failed.direct_from
    if failed.by is None:
        return f"told to {sender}"
    how = "went on"
    if failed.by.end is None or failed.by.end > known:
        how = "still runs"
    elif failed.by.outcome is Outcome.FAILED:
        how = (
            "failed then, and that was handled"
            if run_continued(run, failed, time, known)
            else "failed then"
        )
    return f"told to {sender}, whose handler of {run.describe(failed.by.message_id)} {how}"


def _passed_on(
    run: Run, failed: Failing, time: float, known: float = inf
) -> Iterator[tuple[Failing, float]]:
    """The chain of failures and their times: as far as a task, or an asker that was told and did
    not fail.
    """
    while True:
        yield failed, time
        if isinstance(failed, Task) or not is_reported(run, failed, time):
            return
        handling = failed.by
        if monitor := _monitor(run, failed):
            failed = monitor
        elif (
            handling is not None
            and handling.outcome is Outcome.FAILED
            and (handling.end or 0.0) <= known
        ):
            failed, time = (
                failing(run, handling),
                handling.end or time,
            )  # older than what it asked, so this ends
        else:
            return


def _has_asker(run: Run, failed: Failing) -> bool:
    """Whether somebody asked, and has an answer to come."""
    if isinstance(failed, Message):
        return failed.message_class.has_reply
    known = run.formats.get(failed.name)
    return known is not None and known.message_class.has_reply


def _why_untold(run: Run, failed: Failing, time: float) -> str:
    """Why of a query that fails at *time* nobody is told; "" if somebody is. Entries have times of
    their own, so what happened at the same time is of the same event, in which who asks may fail
    with it.
    """
    handling = failed.by
    if isinstance(failed, Message):
        if failed.was("dropped", time):
            return (
                "its sender had given up"
                if failed.was_given_up
                else "nobody waited for the answer any more"
            )
        if failed.answered is not None and failed.answered < time:
            return "its sender had enough answers"
        if (monitor := _monitor(run, failed)) and _stopped_watching(
            run, monitor, failed.received, time
        ):
            return f"{monitor} watched no longer"
    if handling is not None and handling.end is not None and handling.end < time:
        return f"the handler of {run.describe(handling.message_id)} that asked had ended"
    return ""


def _stopped_watching(run: Run, monitor: Task, asked: float, time: float) -> bool:
    """Whether a monitor had ended, or begun anew, when a condition that it had asked failed: it
    does not fail, too.
    """
    failed = {when for when, _ in monitor.failures}
    failed.update(one.time for one in run.raised.get(monitor.id, ()))  # with the same text, too
    if time in failed:
        return False
    begun = {one.time for one in monitor.retries}  # anew, perhaps with that condition
    if any(asked < when <= time for when in begun):
        return True
    ends = [
        when
        for when, why in monitor.became("watched")
        if why and not (when == asked and when in begun)
    ]
    return any(asked <= when <= time for when in (*ends, monitor.time_of(Moment.END_ACHIEVING)))


def _monitor(run: Run, failed: Failing) -> Task | None:
    """The monitor whose condition it is."""
    return (
        run.tasks.get(failed.about)
        if isinstance(failed, Message) and failed.role is Role.CONDITION
        else None
    )


def _of_task(run: Run, task: Task, time: float, known: float = inf) -> Fate:
    """By the first state that decides: killed, or one in which the task goes on, or has ended well.
    For what is killed a task above it may have been begun again, or the top-level task goes on.
    """
    first, last = task.place_at(time), task.place_at(known)
    decided = next(
        (place for place in range(first, last + 1) if task.stage(place)[1] not in UNDECIDED), None
    )
    if decided is None and task.stage(last)[1] is TaskState.RECOVERING:
        return Fate.OPEN
    if decided is not None and task.stage(decided)[1] is not TaskState.KILLED:
        if _was_begun_again(task, time, task.stage(decided)[0]):
            return Fate.RETRIED
        if time not in run.unhandled.get(
            task.id, ()
        ):  # what survives what is above it goes on, though it has failed
            return Fate.DEALT_WITH
    return (
        Fate.RETRIED
        if retried_ancestor(run, task, time, known) is not None
        else _of_killed(run, task, time, known)
    )


def _of_killed(run: Run, task: Task, time: float, known: float) -> Fate:
    """Of a task that was killed: whether the top-level task went on without it. What ends that when
    the exception handler is through was not for this failure.
    """
    top, handler = run.tasks[task.top], _last_called(run, task, time, known)
    if top is not task and top.state_at(known) in DONE:
        return Fate.REPLACED
    if handler is None:
        return Fate.NOT_HANDLED
    through = min(handler.time_of(Moment.END_ACHIEVING), known)
    is_left = time in run.unhandled.get(task.id, ())
    goes_on = top.state_at(through) not in OVER and top.was("killed", through) is None
    return Fate.REPLACED if goes_on and top is not task and not is_left else Fate.KILLED


def _last_called(run: Run, task: Task, time: float, known: float) -> Task | None:
    """The exception handler that was called last, until a moment, for a failure of a task at *time*
    or a later one.
    """
    called = run.children_until(task.caught_by, known)
    newest = next((run.tasks[one] for one in reversed(called) if one in run.tasks), None)
    return newest if newest is not None and newest.received >= time else None


def _was_begun_again(task: Task, time: float, end: float) -> bool:
    """Whether it was to be handled again, or was, after *time* and until *end*."""
    again = task.retries[bisect_right(task.retries, time, key=_SINCE) :][:1]
    runs = task.handlings[bisect_left(task.handlings, time, key=_START) :][:1]
    return any(when <= end for when in (*(one[0] for one in again), *(run.start for run in runs)))


# --- all failures of a run ------------------------------------------------------------------------


class Failed(NamedTuple):
    """A message failed."""

    message: Message
    time: float
    failure: Failure
    until: float
    """When it failed again, or was begun anew (inf: neither)."""
    is_begun_anew: bool
    handling: Handling | None
    """The run of its handler that failed with it; None: it was raised beside that."""
    by: str
    """The module that raised it, or "central"; "" if the journal does not tell."""
    asker: Handling | None
    """The run of a handler that raised it."""


def all_failures(run: Run) -> list[Failed]:
    """Those of all messages, oldest first."""
    return sorted(
        (one for message in run.messages.values() for one in failures_of(run, message)), key=_TIME
    )


def failures_of(run: Run, message: Message) -> Iterator[Failed]:
    """Those of one message, oldest first."""
    if not message.changes:
        return
    had = message.became("failure")
    failed = {one.end: one for one in message.handlings if one.outcome is Outcome.FAILED}
    raised = {(one.time, one.failure): one for one in run.raised.get(message.id, ())}
    for (time, failure), (until, after) in pairwise([*had, (inf, NO_FAILURE)]):
        if not failure:
            continue
        handling, beside = failed.get(time), raised.get((time, failure))
        by, asker = (beside.by, beside.asker) if beside else (CENTRAL, None)
        if handling and not beside and not handling.is_lost:
            by, asker = handling.module, handling
        yield Failed(message, time, failure, until, until < inf and not after, handling, by, asker)
