"""The keepers of a resource: the handlers in it, the lock on it, and the first in line for one.

Asked at a moment it costs what is in the resource then. ``parts_in_queue`` and ``parts_of_claim``
cut a whole wait at every change of its keeper: that costs what happened in the resource meanwhile,
so ask it of waits that people look at.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from itertools import pairwise
from operator import attrgetter
from typing import NamedTuple

from tca_tools.journal.at_time import RunAt, TaskAt, remembered
from tca_tools.journal.records import Claim, HandlerWait, Handling, Message, Queueing
from tca_tools.journal.whole_run import Run
from tca_wire.text.facts_in_words import called

_Key = tuple[str, str]
_NO_TIME = 1e-6
"""Seconds: a keeper that lasts no longer is left out."""


class Keepers(NamedTuple):
    """The keepers of a resource at a moment."""

    runs: tuple[Handling, ...] = ()
    """The handlers that are in it."""
    claim: Claim | None = None
    """The lock or reservation in force, or the first that waits for one."""

    def are(self, others: "Keepers") -> bool:
        """Whether they are the same."""
        runs = [id(one) for one in self.runs]
        return self.claim is others.claim and runs == [id(one) for one in others.runs]


WaitPart = tuple[float, float, Keepers]
"""From when until when (inf: it goes on) the keepers were the same, and these."""


def kept_out(at: RunAt, module: str, resource: str, message: Message | TaskAt) -> Keepers:
    """The keepers of a resource from a queued message: the lock in force, or the next in line even
    if there is room; else the handlers in it.
    """
    held_by = at.held_by(module, resource)
    if held_by is None:
        line = _line_at(at, module, resource)
        first, came = next(iter(line.wanted), None), _came(at.run, message.id)
        if first and (line.has_room or line.inside or first.start < came):
            return Keepers(claim=first)
    elif not (held_by.is_reserved and held_by.sender == _sent_by(at.run, message.id)):
        return Keepers(claim=held_by)
    runs = at.running(module, resource)
    return Keepers(tuple(run for run in runs if run.message_id != message.id))


def ahead_of_claim(at: RunAt, claim: Claim) -> Keepers:
    """The keepers of a resource from a lock: the lock in force; else other handlers in it, and the
    claim ahead.
    """
    held_by = at.held_by(claim.module, claim.resource)
    if held_by is not None and held_by is not claim:
        return Keepers(claim=held_by)
    line = _line_at(at, claim.module, claim.resource)
    before = next((place for place, one in enumerate(line.wanted) if one is claim), 0)
    own: set[int] = set()
    run = claim.by
    while run is not None:  # and what it was called back by waits in the same slot
        own.add(id(run))
        run = line.called_back_by.get(id(run))
    inside = at.inside(claim.module, claim.resource)
    runs = tuple(run for run in inside if id(run) not in own)
    return Keepers(runs, line.wanted[before - 1] if before else None)


def kept_since(at: RunAt, by: Keepers, begun: float) -> float:
    """Since when these keepers keep a wait up that has *begun* then."""
    since = [begun, *(run.start for run in by.runs)]
    if by.claim is not None:
        granted = by.claim.granted
        is_late = granted is None or granted > at.moment
        since.append(by.claim.start if granted is None or is_late else granted)
    return max(since)


class _Line(NamedTuple):
    """The claims that wait to have a resource for themselves."""

    wanted: list[Claim]
    """Locks and reservations: those of who is in the resource first, then as they came."""
    inside: int
    """Those of who is in it: nobody gets in before he is out."""
    has_room: bool
    """Whether a slot is free."""
    called_back_by: dict[int, Handling]
    """For each run that takes no slot, by its identity, the one within whose wait for it it is
    handled.
    """


@remembered
def _line_at(at: RunAt, module: str, resource: str) -> _Line:
    runs, wanted = at.running(module, resource), at.wanted(module, resource)
    inside = [one for one in wanted if any(run is one.by for run in runs)]
    others = [one for one in wanted if one not in inside] if inside else wanted
    capacity, taken = at.capacity(module, resource), 0
    called_back_by: dict[int, Handling] = {}
    for run in runs:
        message = at.run.messages.get(run.message_id)
        by = message.by if message else None
        if taken < capacity or not any(one is by for one in runs):
            taken += 1
        elif by is not None:
            called_back_by[id(run)] = by
    return _Line([*inside, *others], len(inside), capacity > taken, called_back_by)


def _came(run: Run, number: int) -> float:
    """Since when a message has its place in line: who is handled again keeps it."""
    message = run.messages.get(number)
    if message is None:
        return 0.0
    first = (one[0].start for one in (message.queueings, message.handlings) if one)
    return min(first, default=message.received)


def _sent_by(run: Run, number: int) -> str:
    """The sender of a message, or of the message that central made it for."""
    message = run.messages.get(number)
    while message is not None and message.role and message.about < message.id:
        message = run.messages.get(message.about)
    return message.sender if message is not None else ""


# --- over time ------------------------------------------------------------------------------------


def parts_in_queue(run: Run, queueing: Queueing, message: Message) -> list[WaitPart]:
    """The keepers of a resource from a queued message, one after the other."""
    key = queueing.module, queueing.resource
    return _parts(run, queueing, [key], lambda at: kept_out(at, *key, message))


def parts_of_claim(run: Run, wait: HandlerWait, claim: Claim) -> list[WaitPart]:
    """The keepers of a resource from a claim, one after the other: in all copies of the module."""
    copies = (one for one in run.modules if called(one) == called(claim.module))
    keys = [(one, claim.resource) for one in copies]
    return _parts(run, wait, keys, lambda at: ahead_of_claim(at, claim))


def _turns(run: Run, keys: list[_Key], start: float, end: float) -> Iterator[float]:
    """When the keepers of a resource may have changed."""
    for key in keys:
        runs = run.runs.get(key, [])
        first = bisect_right(runs, start, key=attrgetter("start"))
        last = bisect_right(runs, end, key=attrgetter("start"))
        beside = runs[first - 1].beside if first else ()
        for handling in (*beside, *runs[max(first - 1, 0) : last]):
            yield from (handling.start, handling.until)
        if known := run.modules.get(key[0]):
            yield from (time for time, _ in known.sizes.get(key[1], ()))
    for claim in run.asked_for(*keys[0]) if keys else ():
        yield from (claim.start, claim.until)
        if claim.granted is not None:
            yield claim.granted
        if claim.by is not None:
            yield claim.by.until


def _parts(
    run: Run, wait: Queueing | HandlerWait, keys: list[_Key], keepers: Callable[[RunAt], Keepers]
) -> list[WaitPart]:
    start, end = wait.start, wait.until
    turns = _turns(run, keys, start, end)
    stops = sorted({time for time in turns if start < time < end})
    found: list[tuple[float, Keepers]] = []
    for stop, after in pairwise([start, *stops, end]):
        if after - stop < _NO_TIME and (found or after < end):
            continue
        by = keepers(RunAt(run, stop))
        if not found or not by.are(found[-1][1]):
            found.append((stop if found else start, by))
    ends = [*(since for since, _ in found[1:]), end]
    return [(since, until, by) for (since, by), until in zip(found, ends, strict=True)]
