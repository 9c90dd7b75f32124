"""The longest waits of a run: who waited, how long, and for what. Pure."""

import heapq
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from operator import attrgetter

from tca_tools.analysis.words import moment
from tca_tools.past import Past
from tca_tools.records import Claim, Handling, Queueing, State, Suspension, Task, Wait
from tca_tools.story import awaited
from tca_tools.then import Then
from tca_tools.waiting import for_whom, why_in_vain, why_waiting
from tca_wire.points import TaskId
from tca_wire.wording import by_whom, place

_NO_TIME = 1e-6
"""What takes less only tells what came first."""


class WaitKind(StrEnum):
    """What was waited for."""

    CONSTRAINT = "constraint"  # a task was held, by a constraint or by its parent
    SUSPENDED = "suspended"  # a task was suspended, and nothing under it ran on any more
    RESOURCE = "resource"  # a message stood in a queue
    LOCK = "lock"  # the same, or a claim, while somebody had locked or reserved the resource
    HANDLER = "handler"  # nobody handled it
    REPLY = "reply"  # a handler waited for the reply to its query
    TASK = "task"  # a handler waited until a task had come so far


@dataclass(slots=True)
class LongWait:
    """Somebody waited."""

    kind: WaitKind
    who: str
    start: float
    end: float
    is_open: bool
    """Whether it went on when the journal ended."""
    what: str = ""
    """For what, in words: "until take steps {2} is achieved"."""

    @property
    def seconds(self) -> float:
        """How long."""
        return self.end - self.start


@dataclass(slots=True)
class Waits:
    """All waits of one kind."""

    kind: WaitKind
    number: int = 0
    seconds: float = 0.0
    longest: list[LongWait] = field(default_factory=list)


def waits(past: Past, at_most: int = 10) -> list[Waits]:
    """For each kind of wait that took time: how many there were, how long together, and the longest, with reasons."""
    by_kind = {kind: Waits(kind) for kind in WaitKind}
    heaps: dict[WaitKind, list[tuple[float, int, _Found]]] = {kind: [] for kind in WaitKind}
    for number, found in enumerate(_all(past)):
        kind, of_kind = found[0], by_kind[found[0]]
        end = past.time if found[3] is None else found[3]
        seconds = end - found[2]
        if seconds < _NO_TIME:
            continue
        of_kind.number += 1
        of_kind.seconds += seconds
        item = (seconds, -number, found)
        if len(heaps[kind]) < at_most:
            heapq.heappush(heaps[kind], item)
        else:
            heapq.heappushpop(heaps[kind], item)
    for kind, heap in heaps.items():
        by_kind[kind].longest = [_told(past, found) for _, _, found in sorted(heap, reverse=True)]
    return [of_kind for of_kind in by_kind.values() if of_kind.number]


_Found = tuple[WaitKind, int, float, float | None, Queueing | Wait | Suspension | None]
"""A wait: its kind, the message that waits, from when until when, and its record (None: a task that was held)."""


def _all(past: Past) -> Iterator[_Found]:
    yield from _of_tasks(past)
    for queueing in past.queueings:
        kind = WaitKind.HANDLER if not queueing.module else WaitKind.RESOURCE
        if queueing.module and locked_during(past, queueing.module, queueing.resource, queueing.start, queueing.end):
            kind = WaitKind.LOCK
        yield kind, queueing.message_id, queueing.start, queueing.end, queueing
    for handling in past.handlings:
        for wait in handling.waits:
            yield _kind(past, wait), handling.message_id, wait.start, wait.end, wait


def _of_tasks(past: Past) -> Iterator[_Found]:
    for task in past.tasks.values():
        for number, (time, state) in enumerate(task.states):
            if state is State.HELD or state is State.PLANNED:
                end = task.states[number + 1][0] if number + 1 < len(task.states) else None
                yield WaitKind.CONSTRAINT, task.id, time, end, None
    for suspension in past.suspensions():
        if (since := suspension.standstill) is not None:
            yield WaitKind.SUSPENDED, suspension.task, since, suspension.end, suspension


def _kind(past: Past, wait: Wait) -> WaitKind:
    if wait.moment:
        return WaitKind.TASK
    return WaitKind.LOCK if wait.awaited in past.claims else WaitKind.REPLY


def locked_during(past: Past, module: str, resource: str, start: float, end: float | None) -> Claim | None:
    """The last lock or reservation of a resource that was in force at some time between *start* and *end*."""
    grants = past.grants.get((module, resource), [])
    place_before = bisect_left(grants, past.time if end is None else end, key=attrgetter("granted"))
    last = grants[place_before - 1] if place_before else None
    return last if last and (last.end is None or last.end > start) else None


def _told(past: Past, found: _Found) -> LongWait:
    """A wait with its reason: of a task, as it was in the middle."""
    kind, message, start, end, record = found
    told = LongWait(kind, past.describe(message), start, past.time if end is None else end, end is None)
    if isinstance(record, Queueing):
        told.what = _queue_reason(past, record)
    elif isinstance(record, Suspension):
        told.what = _until_resumed(record)
    elif isinstance(record, Wait):
        told.who = f"the handler of {told.who}"
        why = why_in_vain(past, record)
        told.what = awaited(past, record) + (f", in vain: {why}" if why else _where_handled(past, record))
    else:
        told.what = _why_held(past, past.tasks[message], told)
    return told


def _until_resumed(suspension: Suspension) -> str:
    over = suspension.end is not None and not suspension.is_resumed
    text = "until it was killed" if over else "until it is resumed"
    who = by_whom(suspension.by)
    if suspension.standstill == suspension.start:
        return text + (f" (suspended{who})" if who else "")
    return f"{text}; suspended{who} at {moment(suspension.start)}, what ran then ran on"


def _why_held(past: Past, task: Task, wait: LongWait) -> str:
    """What held a task in the middle of its wait."""
    if reasons := why_waiting(Then(past, (wait.start + wait.end) / 2), TaskId(task.id)):
        return " and ".join(reasons)
    is_killed = task.killed is not None and task.written("killed") <= wait.end
    return "until it was killed" if is_killed else "for something that the journal does not tell of"


def _where_handled(past: Past, wait: Wait) -> str:
    """Who was slow: the module that replied."""
    message = past.messages.get(wait.awaited)
    last: Handling | None = message.handlings[-1] if message and message.handlings and not wait.moment else None
    return f" from {place(last.module, last.resource)}" if last else ""


def _queue_reason(past: Past, queueing: Queueing) -> str:
    if not queueing.module:
        return f"for a module that handles {past.name(queueing.message_id)}"
    where = place(queueing.module, queueing.resource)
    if claim := locked_during(past, queueing.module, queueing.resource, queueing.start, queueing.end):
        how = "reserved" if claim.is_reserved else "locked"
        return f"for {where}, which {claim.sender} had {how}{for_whom(past, claim, claim.start)}"
    runs = Then(past, queueing.start).running(queueing.module, queueing.resource)
    busy = [run for run in runs if run.message_id != queueing.message_id]
    with_what = f", busy with {past.describe(busy[0].message_id)}" if busy else ""
    return f"for {where}{with_what}" + (f" and {len(busy) - 1} more" if len(busy) > 1 else "")
