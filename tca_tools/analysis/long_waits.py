"""The longest waits of a run: the waiting message or handler, the duration, and the causes."""

from bisect import bisect_left
from collections.abc import Iterator
from heapq import nlargest
from math import inf, nextafter
from operator import attrgetter, itemgetter
from typing import NamedTuple

from tca_tools.explain.holders import Holders
from tca_tools.explain.wait_words import for_claim, in_queue, of_queueing, wait_for
from tca_tools.explain.waits import NO_TIME, has_come, of_handler_wait, waits_for_display
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import HandlerWait, Queueing, Suspension, Task, TaskState
from tca_tools.journal.whole_run import Run
from tca_wire.text.waits_in_words import causes_in_words, in_words
from tca_wire.waits import WaitFor, WaitKind

KINDS = {
    WaitKind.CONSTRAINT: "Tasks held by constraints or their parents",
    WaitKind.RESUME: "Suspended tasks, once no part of them ran",
    WaitKind.RESOURCE: "Messages in queues of busy resources",
    WaitKind.LOCK: "Waits because of locks and reservations",
    WaitKind.HANDLER: "Messages without a handler",
    WaitKind.REPLY: "Handlers that waited for replies",
    WaitKind.TASK: "Handlers that waited for tasks",
    WaitKind.CHANGE: "Handlers that waited for changes of tasks",
    WaitKind.PRESENCE: "Handlers that waited until messages were handled",
}
"""The headings for the kinds of waits that are counted."""


class LongWait(NamedTuple):
    """A wait of a message or a handler."""

    who: str
    """The waiting message, or the handler of one."""
    start: float
    seconds: float
    is_open: bool
    """Whether it had not ended when the journal ended."""
    what: str
    """The cause in words: "until take steps {2} is achieved"."""


class WaitsOfKind(NamedTuple):
    """All waits of one kind."""

    kind: WaitKind
    number: int
    seconds: float
    longest: list[LongWait]


class _Found(NamedTuple):
    """A wait, with the record that it was read from."""

    kind: WaitKind
    message_id: int
    start: float
    end: float
    record: Queueing | HandlerWait | Suspension | Task


def long_waits(run: Run, at_most: int = 10) -> list[WaitsOfKind]:
    """Return the waits by kind: their number, their total duration, and the longest with reasons.

    Args:
        run: The run.
        at_most: The number of waits listed for each kind.
    """
    found: dict[WaitKind, list[tuple[float, _Found]]] = {kind: [] for kind in KINDS}
    for one in _all_waits(run):
        seconds = min(one.end, run.time) - one.start
        if seconds >= NO_TIME:
            found[one.kind].append((seconds, one))
    kinds: list[WaitsOfKind] = []
    for kind, waits in found.items():
        longest = []
        for seconds, one in nlargest(at_most, waits, key=itemgetter(0)):
            who = run.describe(one.message_id)
            if isinstance(one.record, HandlerWait):
                who = f"the handler of {who}"
            longest.append(LongWait(who, one.start, seconds, one.end == inf, _cause(run, one)))
        if waits:
            total = sum(seconds for seconds, _ in waits)
            kinds.append(WaitsOfKind(kind, len(waits), total, longest))
    return kinds


def _all_waits(run: Run) -> Iterator[_Found]:
    """Yield the times of messages held, suspended or queued, and the waits of handlers."""
    for task in run.tasks.values():
        for since, end, state in task.spans():
            if state in (TaskState.HELD, TaskState.PLANNED):
                yield _Found(WaitKind.CONSTRAINT, task.id, since, end, task)
    for one in run.suspensions():
        if one.standstill is not None:
            yield _Found(WaitKind.RESUME, one.task, one.standstill, one.until, one)
    for queueing in run.queueings:
        kind, number = _kind(run, queueing), queueing.message_id
        yield _Found(kind, number, queueing.start, queueing.until, queueing)
    for handling in run.handlings:
        for wait in handling.waits:
            kind = of_handler_wait(run, wait).kind
            yield _Found(kind, handling.message_id, wait.start, wait.until, wait)


def _kind(run: Run, queueing: Queueing) -> WaitKind:
    """Return whether a queued message had no handler, a locked resource, or just a busy one."""
    if not queueing.module:
        return WaitKind.HANDLER
    grants = run.granted(queueing.module, queueing.resource)
    granted = bisect_left(grants, min(queueing.until, run.time), key=attrgetter("granted"))
    last = grants[max(granted - 1, 0) : granted]
    was_locked = any(one.until > queueing.start for one in last)
    return WaitKind.LOCK if was_locked else WaitKind.RESOURCE


def _cause(run: Run, found: _Found) -> str:
    match found.record:
        case HandlerWait() as wait:
            return handler_wait_in_words(run, wait)
        case Suspension() as suspension:
            by, since_birth = suspension.by, suspension.since_birth
            return in_words(WaitFor(WaitKind.RESUME, module=by, since_birth=since_birth))
        case Queueing() as queueing:
            return _in_queue(run, queueing)
        case Task() as task:
            return _why_held(run, task, found)


def _in_queue(run: Run, queueing: Queueing) -> str:
    message = run.messages.get(queueing.message_id)
    if message is None or not queueing.module:
        return in_words(of_queueing(RunAt(run, queueing.start), Holders(), queueing))
    return in_queue(run, queueing, message)


def _why_held(run: Run, task: Task, found: _Found) -> str:
    """Return the causes that held a task, each with its duration."""
    causes = []
    for wait in waits_for_display(run, task):
        if found.start <= wait.start < found.end:
            seconds = min(wait.end, run.time) - wait.start
            causes.append((wait_for(RunAt(run, wait.start), wait), seconds))
    if causes:
        return causes_in_words(causes)
    if task.killed is not None and task.written_at("killed") <= found.end:
        return "until it was killed"
    return "for something not in the journal"


def handler_wait_in_words(run: Run, wait: HandlerWait) -> str:
    """Return the wait of a handler or program in words, and whether it was in vain."""
    in_vain, cycle = ", in vain" * is_in_vain(run, wait), run.deadlock(wait)
    if (claim := run.claims.get(wait.awaited)) is not None:
        return for_claim(run, wait, claim) + in_vain
    at = RunAt(run, nextafter(wait.until, 0.0))
    text = in_words(wait_for(at, of_handler_wait(run, wait))) + in_vain
    return f"{text}: {cycle}" if cycle else text


def is_in_vain(run: Run, wait: HandlerWait) -> bool:
    """Whether a wait ended before the awaited event happened."""
    if wait.end is None:
        return False
    if run.deadlock(wait):
        return True
    claim, query = run.claims.get(wait.awaited), run.messages.get(wait.awaited)
    if claim is not None:
        return claim.granted is None or claim.granted > wait.end
    if isinstance(query, Task):
        return not has_come(run, wait)
    return query is not None and query.was_given_up
