"""The longest waits of a run: who waited, how long, and for what, cut by cause."""

import heapq
from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import inf, nextafter
from operator import attrgetter
from typing import NamedTuple

from tca_tools.run.at_time import RunAt
from tca_tools.run.records import HandlerWait, Queueing, State, Suspension, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.keepers import Keepers, Part, parts_in_queue, parts_of_claim
from tca_tools.why.wait_words import of_claim, of_queueing, wait_for
from tca_tools.why.waits import NO_TIME, of_handler_wait, told_waits
from tca_wire.text.facts_in_words import by_whom
from tca_wire.text.measures import run_time
from tca_wire.text.waits_in_words import causes_in_words, in_words
from tca_wire.waits import WaitFor, WaitKind

KINDS = {
    WaitKind.CONSTRAINT: "Tasks held by constraints or their parents",
    WaitKind.RESUME: "Suspended tasks, from when on nothing of them ran any more",
    WaitKind.RESOURCE: "Messages in queues of busy resources",
    WaitKind.LOCK: "Waits because of locks and reservations",
    WaitKind.HANDLER: "Messages that nobody handled",
    WaitKind.REPLY: "Handlers that waited for replies",
    WaitKind.TASK: "Handlers that waited for tasks",
}
"""The kinds of waits that are counted, as headings."""


class LongWait(NamedTuple):
    """Somebody waited."""

    who: str
    start: float
    end: float
    is_open: bool
    """Whether it went on when the journal ended."""
    what: str
    """For what, in words: "until take steps {2} is achieved"."""

    @property
    def seconds(self) -> float:
        """How long."""
        return self.end - self.start


@dataclass(slots=True)
class WaitsOfKind:
    """All waits of one kind."""

    kind: WaitKind
    number: int = 0
    seconds: float = 0.0
    longest: list[LongWait] = field(default_factory=list)


class _Found(NamedTuple):
    kind: WaitKind
    message_id: int
    start: float
    end: float | None
    record: Queueing | HandlerWait | Suspension | Task


def long_waits(run: Run, at_most: int = 10) -> list[WaitsOfKind]:
    """For each kind of wait that took time: how many there were, how long together, and the longest, with reasons."""
    of_kinds = {kind: WaitsOfKind(kind) for kind in KINDS}
    longest: dict[WaitKind, list[tuple[float, int, _Found]]] = {kind: [] for kind in KINDS}
    for number, found in enumerate(_all(run)):
        seconds = (run.time if found.end is None else found.end) - found.start
        if seconds < NO_TIME:
            continue
        of_kind = of_kinds[found.kind]
        of_kind.number += 1
        of_kind.seconds += seconds
        heap = longest[found.kind]
        push = heapq.heappush if len(heap) < at_most else heapq.heappushpop
        push(heap, (seconds, -number, found))
    for kind, heap in longest.items():
        of_kinds[kind].longest = [_described(run, found) for _, _, found in sorted(heap, reverse=True)]
    return [of_kind for of_kind in of_kinds.values() if of_kind.number]


def _all(run: Run) -> Iterator[_Found]:
    for task in run.tasks.values():
        for since, end, state in task.spans():
            if state in (State.HELD, State.PLANNED):
                yield _Found(WaitKind.CONSTRAINT, task.id, since, None if end == inf else end, task)
    yield from _of_the_rest(run)


def _of_the_rest(run: Run) -> Iterator[_Found]:
    """What is suspended or queued, and what handlers wait for."""
    for suspension in run.suspensions():
        if (still := suspension.standstill) is not None:
            yield _Found(WaitKind.RESUME, suspension.task, still, suspension.end, suspension)
    for queueing in run.queueings:
        kind = WaitKind.RESOURCE if queueing.module else WaitKind.HANDLER
        if queueing.module and _was_locked(run, queueing):
            kind = WaitKind.LOCK
        yield _Found(kind, queueing.message_id, queueing.start, queueing.end, queueing)
    for handling in run.handlings:
        for wait in handling.waits:
            yield _Found(of_handler_wait(run, wait).kind, handling.message_id, wait.start, wait.end, wait)


def _was_locked(run: Run, queueing: Queueing) -> bool:
    """Whether the resource was locked or reserved at some time of a stay in its queue."""
    grants = run.granted(queueing.module, queueing.resource)
    place_before = bisect_left(grants, run.time if queueing.end is None else queueing.end, key=attrgetter("granted"))
    last = grants[place_before - 1] if place_before else None
    return last is not None and (last.end is None or last.end > queueing.start)


def _described(run: Run, found: _Found) -> LongWait:
    who, record = run.describe(found.message_id), found.record
    if isinstance(record, Queueing):
        what = _in_queue(run, record)
    elif isinstance(record, Suspension):
        what = _until_resumed(record)
    elif isinstance(record, HandlerWait):
        who, what = f"the handler of {who}", handler_wait_in_words(run, record)
    else:
        what = _why_held(run, record, found)
    return LongWait(who, found.start, run.time if found.end is None else found.end, found.end is None, what)


def _in_queue(run: Run, queueing: Queueing) -> str:
    message = run.messages.get(queueing.message_id)
    if message is None or not queueing.module:
        return in_words(of_queueing(RunAt(run, queueing.start), queueing, Keepers()))
    return _cut(run, parts_in_queue(run, queueing, message), lambda at, part: of_queueing(at, queueing, part.by))


def _cut(run: Run, parts: list[Part], made: Callable[[RunAt, Part], WaitFor]) -> str:
    return causes_in_words((made(RunAt(run, part.start), part), min(part.end, run.time) - part.start) for part in parts)


def _until_resumed(suspension: Suspension) -> str:
    over = suspension.end is not None and not suspension.is_resumed
    text = "until it was killed" if over else "until it is resumed"
    who = by_whom(suspension.by)
    if suspension.standstill == suspension.start:
        return text + (f" (suspended{who})" if who else "")
    return f"{text}; suspended{who} at {run_time(suspension.start)}, what ran then ran on"


def _why_held(run: Run, task: Task, found: _Found) -> str:
    """What held a task, each cause with how long it did."""
    end = inf if found.end is None else found.end
    waits = [wait for wait in told_waits(run, task) if found.start <= wait.start < end]
    causes = ((wait_for(RunAt(run, wait.start), wait), min(wait.end, run.time) - wait.start) for wait in waits)
    if waits:
        return causes_in_words(causes)
    is_killed = task.killed is not None and task.written("killed") <= end
    return "until it was killed" if is_killed else "for something that the journal does not tell of"


def handler_wait_in_words(run: Run, wait: HandlerWait) -> str:
    """What a handler or program waited for, and whether that was in vain."""
    claim = run.claims.get(wait.awaited)
    if claim is not None:
        text = _cut(run, parts_of_claim(run, wait, claim), lambda at, part: of_claim(at, claim, part.by))
        return text + ", in vain" * is_in_vain(run, wait)
    is_open = wait.end is None
    at = RunAt(run) if wait.end is None else RunAt(run, nextafter(wait.end, 0.0))
    text = in_words(wait_for(at, of_handler_wait(run, wait)))
    circle = "" if is_open else run.deadlock(wait)
    return text + (", in vain" + (f": {circle}" if circle else "")) * is_in_vain(run, wait)


def is_in_vain(run: Run, wait: HandlerWait) -> bool:
    """Whether what was waited for had not come when the wait was over."""
    if wait.end is None:
        return False
    if run.deadlock(wait):
        return True
    claim, task, query = run.claims.get(wait.awaited), run.tasks.get(wait.awaited), run.messages.get(wait.awaited)
    if claim is not None:
        return claim.granted is None or claim.granted > wait.end
    if wait.moment:
        return task is not None and task.reached.get(wait.moment, inf) > wait.end
    return query is not None and query.was_given_up
