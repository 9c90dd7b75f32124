"""The failures of a run, the fate of each, and whether the run continued after it.

The fate of a task's failure follows from the task's later states. The failure of a query is
reported to its asker. If the asking handler fails too, the failure of the query has the same fate
as the failure of the handler. An asker that had given up or ended gets no report. A program outside
of handlers does not fail.

All tools use this module. Pure; each step is O(log n) in the number of one message's changes.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from enum import StrEnum
from itertools import pairwise
from math import inf
from operator import attrgetter
from typing import NamedTuple

from tca_tools.journal.failure import NO_FAILURE, Failure
from tca_tools.journal.records import (
    DONE,
    OVER,
    Handling,
    Message,
    Task,
    TaskState,
)
from tca_tools.journal.whole_run import Run
from tca_wire.points import Moment
from tca_wire.vocabulary import CENTRAL, Outcome, Role

_START, _TIME = attrgetter("start"), attrgetter("time")
UNDECIDED = (TaskState.RECOVERING, TaskState.ENDING, TaskState.FAILED)
"""States of a task directly after a failure; the state after them decides its fate."""

HANDLED = "failed (handled)"
"""The standing of a failed task if the run continued after the failure."""
WATCHING = "watching"
"""The standing of a monitor that is watching; its state is *achieving*."""
_AFTER = {TaskState.FAILED: HANDLED, TaskState.ACHIEVING: WATCHING}
"""The standings that are not states, by the state that they follow in lists."""
STANDINGS = tuple(
    word for state in TaskState for word in (state, _AFTER.get(state)) if word is not None
)
"""All words for a task's standing, in the order in which tools list them."""


class Fate(StrEnum):
    """The fate of a failure."""

    RETRIED = "retried"  # the task was handled again, or it was killed for an ancestor's retry
    DEALT_WITH = "recovered"
    REPLACED = "replaced"  # the task was killed; the top-level task continued or was achieved
    KILLED = "killed"  # the task and the top-level task were killed
    NOT_HANDLED = "unhandled"  # no exception handler was found
    ASKER_CONTINUED = "asker_continued"  # a query's asker got the report, and continued
    REPORTED = "reported"  # a query's asker, outside of handlers, got the report
    ASKER_FAILED = (
        "asker_failed"  # a query's asker got the report, and its own failure was not handled
    )
    NOT_REPORTED = "unreported"  # an inform or the like; a query whose sender no longer waited
    OPEN = "open"  # not decided when the journal ended

    @property
    def words(self) -> str:
        """The fate in words for the user."""
        return _WORDS.get(self, self.value)


_WORDS = {
    Fate.DEALT_WITH: "dealt with",
    Fate.NOT_HANDLED: "not handled",
    Fate.ASKER_CONTINUED: "reported to the asker, which continued",
    Fate.REPORTED: "reported to the asker",
    Fate.ASKER_FAILED: "reported to the asker, which failed",
    Fate.NOT_REPORTED: "not reported",
}

GOOD_FATES = (Fate.RETRIED, Fate.DEALT_WITH, Fate.REPLACED, Fate.ASKER_CONTINUED, Fate.REPORTED)
"""The fates after which the robot continued, as far as the journal shows."""
ENDED_TASKS = (Fate.REPLACED, Fate.KILLED, Fate.NOT_HANDLED)
"""The fates with which the failed task ended."""


def fate(run: Run, failed: Message, time: float, as_of: float = inf) -> Fate:
    """Return the fate of a failure.

    Args:
        run: The run.
        failed: The message that failed.
        time: When it failed.
        as_of: The instant as of which the fate is returned; the end of the records by default.
    """
    if isinstance(failed, Task):
        return _fate_of_task(run, failed, time, as_of)
    if not is_reported(run, failed, time):
        return Fate.NOT_REPORTED
    if failed.by is None and _monitor(run, failed) is None:
        return Fate.REPORTED
    return Fate.ASKER_CONTINUED if run_continued(run, failed, time, as_of) else Fate.ASKER_FAILED


def run_continued(run: Run, failed: Message, time: float, as_of: float = inf) -> bool:
    """Whether the run continued after a failure at *time*, or still may, as known at *as_of*."""
    *_, (last, when) = _failure_chain(run, failed, time, as_of)
    if isinstance(last, Task):
        has_failed = any(since <= as_of for since, _ in last.old_values("failure")[:1])
        return has_failed and _fate_of_task(run, last, when, as_of) in (*GOOD_FATES, Fate.OPEN)
    return last is not None and is_reported(run, last, when)


def is_reported(run: Run, failed: Message, time: float) -> bool:
    """Whether the failure of a query at *time* was reported to its asker."""
    return failed.message_class.has_reply and not _why_unreported(run, failed, time)


def has_run_survived(
    run: Run, message: Message, instant: float = inf, as_of: float | None = None
) -> bool:
    """Whether a message had failed at *instant* and the run continued, as known then or later.

    Args:
        run: The run.
        message: The message.
        instant: The instant by which it had failed.
        as_of: The instant as of which the run is judged; *instant* by default.
    """
    failed_at = message.written_at("failure", instant)
    return bool(message.value_at("failure", instant)) and run_continued(
        run, message, failed_at, instant if as_of is None else as_of
    )


def standing(run: Run, task: Task, state: TaskState, instant: float = inf) -> str:
    """Return the standing of a task in a state at an instant: one of ``STANDINGS``."""
    if is_watching(task, state, instant):
        return WATCHING
    is_handled = state is TaskState.FAILED and has_run_survived(run, task, instant)
    return HANDLED if is_handled else str(state)


def is_watching(task: Task, state: TaskState, instant: float = inf) -> bool:
    """Whether a task is a monitor that is watching."""
    if state not in (TaskState.ACHIEVING, TaskState.PLANNING) or not task.message_class.is_monitor:
        return False
    if task.time_of(Moment.START_HANDLING) > instant:
        return False
    place = bisect_right(task.retries, instant, key=_TIME)
    retried = task.retries[place - 1].time if place else 0.0
    # A retry after it had stopped lets it watch again
    return not task.value_at("watched", instant) or retried >= task.written_at("watched", instant)


def watching_spans(task: Task) -> Iterator[tuple[float, float]]:
    """Yield the spans in which a monitor was watching."""
    begun, watched = task.time_of(Moment.START_HANDLING), list[tuple[float, float]]()
    for stopped in (time for time, why in task.new_values("watched") if why):
        watched.append((begun, stopped))
        begun = min((one.time for one in task.retries if one.time >= stopped), default=inf)
    watched.append((begun, inf))
    for since, over, state in task.spans():
        for start, end in watched if state in (TaskState.ACHIEVING, TaskState.PLANNING) else ():
            if max(start, since) < min(end, over):
                yield max(start, since), min(end, over)


def run_continued_after(run: Run, handling: Handling) -> bool:
    """Whether the run continued after a handler failed."""
    failed = run.messages.get(handling.message_id)
    if failed is None or handling.end is None:
        return False
    return run_continued(run, failed, handling.end)


def still_deciding(run: Run, failed: Message, time: float) -> list[Task | Handling]:
    """Return the tasks and handlers that will decide whether the run continues; [] if decided."""
    *_, (last, when) = _failure_chain(run, failed, time)
    if not isinstance(last, Task):
        asker = None if last is None else last.by
        if last is None or asker is None or asker.end is not None:
            return []
        return [asker] if is_reported(run, last, when) else []
    became, top = _fate_of_task(run, last, when), run.tasks[last.top]
    handler = _last_called(run, last, when, inf)
    is_decided = top.state in DONE or (handler is not None and handler.has_ended)
    if became in (Fate.RETRIED, Fate.DEALT_WITH) or (became is Fate.REPLACED and is_decided):
        return []
    return [last, top]


def retried_ancestor(run: Run, task: Task, time: float, as_of: float = inf) -> Task | None:
    """Return the ancestor whose retry killed a failed task; None if none did.

    Args:
        run: The run.
        task: The failed task.
        time: When it failed.
        as_of: The instant as of which this is returned.
    """
    killed_at = task.written_at("killed", as_of)
    if task.value_at("killed", as_of) is None or killed_at < time:
        return None
    while task.parent in run.tasks:  # the tasks between them were killed at the same time
        task = run.tasks[task.parent]
        place = bisect_left(task.retries, killed_at, key=_TIME)
        if any(retry.time == killed_at for retry in task.retries[place : place + 1]):
            return task
        if task.killed is None or task.written_at("killed") != killed_at:
            return None
    return None


def describe_asker(run: Run, failed: Message, time: float, as_of: float = inf) -> str:
    """Describe who got the report of a failed query and how that asker ended, or why none did."""
    if not failed.message_class.has_reply:
        return ""
    if why := _why_unreported(run, failed, time):
        return f"{Fate.NOT_REPORTED.words}: {why}"
    if failed.role is Role.CONDITION:
        return f"reported to central, for {run.describe(failed.about)}"
    if failed.by is None:
        return f"reported to {failed.sender}"
    how = "continued"
    if failed.by.end is None or failed.by.end > as_of:
        how = "still runs"
    elif failed.by.outcome is Outcome.FAILED:
        is_handled = run_continued(run, failed, time, as_of)
        how = "then failed, which was handled" if is_handled else "then failed"
    return (
        f"reported to {failed.sender}, whose handler of {run.describe(failed.by.message_id)} {how}"
    )


def _failure_chain(
    run: Run, message: Message, time: float, as_of: float = inf
) -> Iterator[tuple[Message | None, float]]:
    """Yield a failure and those it caused, with their times.

    The last one is the failure of a task, or a failure that made no asker fail. It is None if the
    journal does not have the message whose handler failed.
    """
    failed: Message | None = message
    while True:
        yield failed, time
        if failed is None or isinstance(failed, Task) or not is_reported(run, failed, time):
            return
        handling = failed.by
        if monitor := _monitor(run, failed):
            failed = monitor
        elif (
            handling is not None
            and handling.outcome is Outcome.FAILED
            and (handling.end or 0.0) <= as_of
        ):
            # The loop ends, since a handler's message is older than the query
            failed, time = run.messages.get(handling.message_id), handling.end or time
        else:
            return


def _why_unreported(run: Run, failed: Message, time: float) -> str:
    """Return why a query's failure at *time* was not reported to the asker; "" if it was.

    Facts with the same time belong to one event. An asker that failed at *time* therefore failed
    with its query, and had got the report.
    """
    handling = failed.by
    if failed.value_at("dropped", time):
        if failed.was_given_up:
            return "its sender had given up"
        return "the answer was no longer awaited"
    if failed.answered is not None and failed.answered < time:
        return "its sender had enough answers"
    monitor = _monitor(run, failed)
    if monitor and _stopped_watching(run, monitor, failed.received, time):
        return f"{monitor} had stopped watching"
    if handling is not None and handling.end is not None and handling.end < time:
        return f"the asking handler of {run.describe(handling.message_id)} had ended"
    return ""


def _stopped_watching(run: Run, monitor: Task, asked: float, time: float) -> bool:
    """Whether a monitor had ended or was retried before its query at *asked* failed at *time*."""
    failure_times = {when for when, _ in monitor.failures}
    # A second failure with the same text does not change the field
    failure_times.update(one.time for one in run.raised.get(monitor.id, ()))
    if time in failure_times:
        return False
    retry_times = {one.time for one in monitor.retries}
    if any(asked < when <= time for when in retry_times):
        return True
    ends = [
        when
        for when, why in monitor.new_values("watched")
        if why and not (when == asked and when in retry_times)
    ]
    return any(asked <= when <= time for when in (*ends, monitor.time_of(Moment.END_ACHIEVING)))


def _monitor(run: Run, failed: Message) -> Task | None:
    """Return the monitor whose condition failed; None for another message."""
    return run.tasks.get(failed.about) if failed.role is Role.CONDITION else None


def _fate_of_task(run: Run, task: Task, time: float, as_of: float = inf) -> Fate:
    """Return the fate of a task's failure, from the first later state that decides it.

    If that state is *killed*, the fate depends on other tasks: an ancestor may have been retried,
    or the top-level task may have continued.
    """
    first, last = task.place_at(time), task.place_at(as_of)
    decided = next(
        (place for place in range(first, last + 1) if task.stage(place)[1] not in UNDECIDED), None
    )
    if decided is None and task.stage(last)[1] is TaskState.RECOVERING:
        return Fate.OPEN
    if decided is not None and task.stage(decided)[1] is not TaskState.KILLED:
        if _was_retried(task, time, task.stage(decided)[0]):
            return Fate.RETRIED
        # A task that survives its ancestor's kill continues after a failure that was not handled
        if time not in run.unhandled.get(task.id, ()):
            return Fate.DEALT_WITH
    if retried_ancestor(run, task, time, as_of) is not None:
        return Fate.RETRIED
    return _fate_of_killed(run, task, time, as_of)


def _fate_of_killed(run: Run, task: Task, time: float, as_of: float) -> Fate:
    """Return the fate of a killed task's failure: whether the top-level task continued without it.

    If the top-level task was still open when the exception handler ended, this failure was not the
    reason for its end.
    """
    top, handler = run.tasks[task.top], _last_called(run, task, time, as_of)
    if top is not task and top.state_at(as_of) in DONE:
        return Fate.REPLACED
    if handler is None:
        return Fate.NOT_HANDLED
    ended = min(handler.time_of(Moment.END_ACHIEVING), as_of)
    is_unhandled = time in run.unhandled.get(task.id, ())
    continued = top.state_at(ended) not in OVER and top.value_at("killed", ended) is None
    return Fate.REPLACED if continued and top is not task and not is_unhandled else Fate.KILLED


def _last_called(run: Run, task: Task, time: float, as_of: float) -> Task | None:
    """Return the last exception handler called for a task's failures since *time*."""
    handlers = run.children_until(task.caught_by, as_of)
    newest = next((run.tasks[one] for one in reversed(handlers) if one in run.tasks), None)
    return newest if newest is not None and newest.received >= time else None


def _was_retried(task: Task, time: float, end: float) -> bool:
    """Whether a retry was due or started after *time* and until *end*."""
    retries = task.retries[bisect_right(task.retries, time, key=_TIME) :][:1]
    handlings = task.handlings[bisect_left(task.handlings, time, key=_START) :][:1]
    starts = (*(one.time for one in retries), *(one.start for one in handlings))
    return any(when <= end for when in starts)


# --- all failures of a run ------------------------------------------------------------------------


class Failed(NamedTuple):
    """The failure of a message."""

    message: Message
    time: float
    failure: Failure
    until: float
    """When it failed again or was handled again (inf: neither)."""
    is_handled_again: bool
    handling: Handling | None
    """The run of its handler that failed; None if the failure was raised beside its handler."""
    by: str
    """The module that raised it, or "central"; "" if that is unknown."""
    asker: Handling | None
    """The run of a handler that raised it."""


def all_failures(run: Run) -> list[Failed]:
    """Return the failures of all messages, oldest first."""
    return sorted(
        (one for message in run.messages.values() for one in failures_of(run, message)), key=_TIME
    )


def failures_of(run: Run, message: Message) -> Iterator[Failed]:
    """Yield the failures of one message, oldest first."""
    if not message.changes:
        return
    values = message.new_values("failure")
    by_end = {one.end: one for one in message.handlings if one.outcome is Outcome.FAILED}
    raised = {(one.time, one.failure): one for one in run.raised.get(message.id, ())}
    for (time, failure), (until, after) in pairwise([*values, (inf, NO_FAILURE)]):
        if not failure:
            continue
        handling, beside = by_end.get(time), raised.get((time, failure))
        by, asker = (beside.by, beside.asker) if beside else (CENTRAL, None)
        if handling and not beside and not handling.is_lost:
            by, asker = handling.module, handling
        yield Failed(message, time, failure, until, until < inf and not after, handling, by, asker)
