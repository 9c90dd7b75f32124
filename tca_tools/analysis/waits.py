"""The longest waits of a run: who waited, how long, and for what. Pure."""

import heapq
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from operator import attrgetter

from tca_tools.analysis.words import moment, seconds
from tca_tools.run.records import Claim, HandlerWait, Handling, Queueing, State, Suspension, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.story import awaited
from tca_tools.why.stretches import NO_TIME, OTHERS, Stretch, for_claim, in_queue, in_state
from tca_tools.why.whereabouts import why_in_vain
from tca_wire.text.facts_in_words import by_whom, place

_NAMED = 3
"""Causes of one wait that are named."""
_BUSY = "busy with "


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


def waits(run: Run, at_most: int = 10) -> list[Waits]:
    """For each kind of wait that took time: how many there were, how long together, and the longest, with reasons."""
    by_kind = {kind: Waits(kind) for kind in WaitKind}
    heaps: dict[WaitKind, list[tuple[float, int, _Found]]] = {kind: [] for kind in WaitKind}
    for number, found in enumerate(_all(run)):
        kind, of_kind = found[0], by_kind[found[0]]
        end = run.time if found[3] is None else found[3]
        length = end - found[2]
        if length < NO_TIME:
            continue
        of_kind.number += 1
        of_kind.seconds += length
        item = (length, -number, found)
        if len(heaps[kind]) < at_most:
            heapq.heappush(heaps[kind], item)
        else:
            heapq.heappushpop(heaps[kind], item)
    for kind, heap in heaps.items():
        by_kind[kind].longest = [_told(run, found) for _, _, found in sorted(heap, reverse=True)]
    return [of_kind for of_kind in by_kind.values() if of_kind.number]


_Found = tuple[WaitKind, int, float, float | None, Queueing | HandlerWait | Suspension | None]
"""A wait: its kind, the message that waits, from when until when, and its record (None: a task that was held)."""


def _all(run: Run) -> Iterator[_Found]:
    yield from _of_tasks(run)
    for queueing in run.queueings:
        kind = WaitKind.HANDLER if not queueing.module else WaitKind.RESOURCE
        if queueing.module and locked_during(run, queueing.module, queueing.resource, queueing.start, queueing.end):
            kind = WaitKind.LOCK
        yield kind, queueing.message_id, queueing.start, queueing.end, queueing
    for handling in run.handlings:
        for wait in handling.waits:
            yield _kind(run, wait), handling.message_id, wait.start, wait.end, wait


def _of_tasks(run: Run) -> Iterator[_Found]:
    for task in run.tasks.values():
        for number, (time, state) in enumerate(task.states):
            if state is State.HELD or state is State.PLANNED:
                end = task.states[number + 1][0] if number + 1 < len(task.states) else None
                yield WaitKind.CONSTRAINT, task.id, time, end, None
    for suspension in run.suspensions():
        if (since := suspension.standstill) is not None:
            yield WaitKind.SUSPENDED, suspension.task, since, suspension.end, suspension


def _kind(run: Run, wait: HandlerWait) -> WaitKind:
    if wait.moment:
        return WaitKind.TASK
    return WaitKind.LOCK if wait.awaited in run.claims else WaitKind.REPLY


def locked_during(run: Run, module: str, resource: str, start: float, end: float | None) -> Claim | None:
    """The last lock or reservation of a resource that was in force at some time between *start* and *end*."""
    grants = run.granted(module, resource)
    place_before = bisect_left(grants, run.time if end is None else end, key=attrgetter("granted"))
    last = grants[place_before - 1] if place_before else None
    return last if last and (last.end is None or last.end > start) else None


def _told(run: Run, found: _Found) -> LongWait:
    """A wait with its reasons, and of several how long each was one."""
    kind, message, start, end, record = found
    told = LongWait(kind, run.describe(message), start, run.time if end is None else end, end is None)
    if isinstance(record, Queueing):
        told.what = _queue_reason(run, record)
    elif isinstance(record, Suspension):
        told.what = _until_resumed(record)
    elif isinstance(record, HandlerWait):
        told.who = f"the handler of {told.who}"
        why = why_in_vain(run, record)
        told.what = _awaited(run, record) + (f", in vain: {why}" if why else _where_handled(run, record))
    else:
        told.what = _why_held(run, run.tasks[message], told)
    return told


def _until_resumed(suspension: Suspension) -> str:
    over = suspension.end is not None and not suspension.is_resumed
    text = "until it was killed" if over else "until it is resumed"
    who = by_whom(suspension.by)
    if suspension.standstill == suspension.start:
        return text + (f" (suspended{who})" if who else "")
    return f"{text}; suspended{who} at {moment(suspension.start)}, what ran then ran on"


def _why_held(run: Run, task: Task, wait: LongWait) -> str:
    """What held a task."""
    number = next(number for number, (time, _) in enumerate(task.states) if time == wait.start)
    is_killed = task.killed is not None and task.written("killed") <= wait.end
    unknown = "until it was killed" if is_killed else "for something that the journal does not tell of"
    return _by_cause(run, in_state(run, task, number), unknown)


def _awaited(run: Run, wait: HandlerWait) -> str:
    """What a handler waited for."""
    claim = run.claims.get(wait.awaited)
    if claim is None:
        return awaited(run, wait)
    parts = [part._replace(why=part.why.removeprefix(f"{claim}, but ")) for part in for_claim(run, wait, claim)]
    if all(part.why == str(claim) for part in parts):
        return f"for the {claim}"
    untold = [part._replace(why="" if part.why == str(claim) else part.why) for part in parts]
    return f"for the {claim}, but {_by_cause(run, untold, 'nobody has it')}"


def _by_cause(run: Run, parts: list[Stretch], unknown: str) -> str:
    """The causes of a wait; of several those with the greatest shares, with how long each was one: ``busy with grip {3}
    (3.00 s), move {4} (2.00 s), and 2 more (0.52 s)``.
    """
    lengths: dict[str, float] = {}
    for part in parts:
        cause = part.why or unknown
        length = (run.time if part.end is None else part.end) - part.start
        if length >= NO_TIME or len(parts) == 1:
            lengths[cause] = lengths.get(cause, 0.0) + length
    if len(lengths) <= 1:
        return next(iter(lengths), unknown)
    greatest = sorted(lengths, key=lambda why: -1.0 if why == OTHERS else lengths[why], reverse=True)[:_NAMED]
    named = [why for why in lengths if why in greatest and why != OTHERS]
    told = [f"{said} ({seconds(lengths[why])})" for why, said in zip(named, _once(named), strict=True)]
    if more := [why for why in lengths if why not in named]:
        many = "others" if OTHERS in more else f"{len(more)} more"
        told.append(f"and {many} ({seconds(sum(lengths[why] for why in more))})")
    return ", ".join(told)


def _once(whys: list[str]) -> Iterator[str]:
    """What resource is busy with something is said once of several in a row."""
    for before, why in pairwise(["", *whys]):
        resource, busy, _ = why.partition(_BUSY)
        yield why.removeprefix(resource + busy) if busy and before.startswith(resource + busy) else why


def _where_handled(run: Run, wait: HandlerWait) -> str:
    """Who was slow: the module that replied."""
    message = run.messages.get(wait.awaited)
    last: Handling | None = message.handlings[-1] if message and message.handlings and not wait.moment else None
    return f" from {place(last.module, last.resource)}" if last else ""


def _queue_reason(run: Run, queueing: Queueing) -> str:
    if not queueing.module:
        return f"for a module that handles {run.name(queueing.message_id)}"
    message = run.messages.get(queueing.message_id)
    parts = in_queue(run, queueing, message) if message else []
    causes = _by_cause(run, parts, "for no reason told") if any(part.why for part in parts) else ""
    return f"for {place(queueing.module, queueing.resource)}" + (f", {causes}" if causes else "")
