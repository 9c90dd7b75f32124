"""The holders of a resource: its running handlers, its lock, and the first pending lock.

At an instant, the cost is proportional to the number of running handlers and pending locks.
``parts_in_queue`` and ``parts_of_claim`` divide a whole wait by its holders. Their cost is
proportional to the events in the resource, so use them only for waits that are shown.
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
"""Parts of a wait that are shorter than this, in seconds, are left out."""


class Holders(NamedTuple):
    """The holders of a resource at an instant."""

    handlings: tuple[Handling, ...] = ()
    """The running handlers."""
    claim: Claim | None = None
    """The lock or reservation in force, or the first pending one."""

    def is_same_as(self, others: "Holders") -> bool:
        """Whether the holders are the same."""
        own, other = ([id(one) for one in each.handlings] for each in (self, others))
        return self.claim is others.claim and own == other


WaitPart = tuple[float, float, Holders]
"""The start and end of a part of a wait (inf: it has not ended), and the holders in it."""


def holders_for_message(
    at: RunAt, module: str, resource: str, message: Message | TaskAt
) -> Holders:
    """Return the holders of a resource that keep a message queued.

    That is the lock in force. Without one, it is a pending lock that comes before the message, even
    if a slot is free. Without a lock, it is the running handlers.
    """
    granted = at.claim_in_force(module, resource)
    if granted is None:
        line = _line_at(at, module, resource)
        first, since = next(iter(line.pending), None), _queued_since(at.run, message.id)
        if first and (line.has_room or line.from_running or first.start < since):
            return Holders(claim=first)
    elif not (granted.is_reserved and granted.sender == _sent_by(at.run, message.id)):
        return Holders(claim=granted)
    running = at.running(module, resource)
    return Holders(tuple(one for one in running if one.message_id != message.id))


def holders_for_claim(at: RunAt, claim: Claim) -> Holders:
    """Return the holders of a resource that keep a lock pending.

    That is the lock in force. Without one, it is the running handlers, except for the handler that
    requested the lock, and the pending lock before this one.
    """
    granted = at.claim_in_force(claim.module, claim.resource)
    if granted is not None and granted is not claim:
        return Holders(claim=granted)
    line = _line_at(at, claim.module, claim.resource)
    place = next((place for place, one in enumerate(line.pending) if one is claim), 0)
    own: set[int] = set()
    handling = claim.by
    # The requesting handler is no holder, nor is a handler that waits for it in the same slot
    while handling is not None:
        own.add(id(handling))
        handling = line.waiting_in_slot.get(id(handling))
    running = at.running_in_copies(claim.module, claim.resource)
    others = tuple(one for one in running if id(one) not in own)
    return Holders(others, line.pending[place - 1] if place else None)


def held_since(at: RunAt, by: Holders, begun: float) -> float:
    """Return since when the holders have caused a wait that started at *begun*."""
    since = [begun, *(one.start for one in by.handlings)]
    if by.claim is not None:
        granted = by.claim.granted
        is_late = granted is None or granted > at.instant
        since.append(by.claim.start if granted is None or is_late else granted)
    return max(since)


class _Line(NamedTuple):
    """The pending claims on a resource."""

    pending: list[Claim]
    """Pending claims: those of running handlers first, then in the order of their requests."""
    from_running: int
    """The number of pending claims of running handlers: no message is handled before these."""
    has_room: bool
    """Whether a slot is free."""
    waiting_in_slot: dict[int, Handling]
    """By identity of a handling without a slot of its own: the waiting handling whose slot it has.
    """


@remembered
def _line_at(at: RunAt, module: str, resource: str) -> _Line:
    running, pending = at.running(module, resource), at.pending_claims(module, resource)
    first = [claim for claim in pending if any(one is claim.by for one in running)]
    others = [claim for claim in pending if claim not in first] if first else pending
    capacity, taken = at.capacity(module, resource), 0
    waiting_in_slot: dict[int, Handling] = {}
    for handling in running:
        message = at.run.messages.get(handling.message_id)
        by = message.by if message else None
        if taken < capacity or not any(one is by for one in running):
            taken += 1
        elif by is not None:
            waiting_in_slot[id(handling)] = by
    return _Line([*first, *others], len(first), capacity > taken, waiting_in_slot)


def _queued_since(run: Run, number: int) -> float:
    """Return when a message got its place in the queue; a retried message retains its place."""
    message = run.messages.get(number)
    if message is None:
        return 0.0
    first = (one[0].start for one in (message.queueings, message.handlings) if one)
    return min(first, default=message.received)


def _sent_by(run: Run, number: int) -> str:
    """Return the sender of a message, or of the message for which central made it."""
    message = run.messages.get(number)
    while message is not None and message.role and message.about < message.id:
        message = run.messages.get(message.about)
    return message.sender if message is not None else ""


# --- over time ------------------------------------------------------------------------------------


def parts_in_queue(run: Run, queueing: Queueing, message: Message) -> list[WaitPart]:
    """Return the holders that kept a message queued, one after the other."""
    key = queueing.module, queueing.resource
    return _parts(run, queueing, [key], lambda at: holders_for_message(at, *key, message))


def parts_of_claim(run: Run, wait: HandlerWait, claim: Claim) -> list[WaitPart]:
    """Return the holders that kept a claim pending, in all copies of the module."""
    copies = (one for one in run.modules if called(one) == called(claim.module))
    keys = [(one, claim.resource) for one in copies]
    return _parts(run, wait, keys, lambda at: holders_for_claim(at, claim))


def _changes(run: Run, keys: list[_Key], start: float, end: float) -> Iterator[float]:
    """Yield the times at which the holders of a resource may have changed."""
    for key in keys:
        handlings = run.by_resource.get(key, [])
        first = bisect_right(handlings, start, key=attrgetter("start"))
        last = bisect_right(handlings, end, key=attrgetter("start"))
        beside = handlings[first - 1].concurrent if first else ()
        for handling in (*beside, *handlings[max(first - 1, 0) : last]):
            yield from (handling.start, handling.until)
        if known := run.modules.get(key[0]):
            yield from (time for time, _ in known.sizes.get(key[1], ()))
    for claim in run.requested_claims(*keys[0]) if keys else ():
        yield from (claim.start, claim.until)
        if claim.granted is not None:
            yield claim.granted
        if claim.by is not None:
            yield claim.by.until


def _parts(
    run: Run, wait: Queueing | HandlerWait, keys: list[_Key], holders: Callable[[RunAt], Holders]
) -> list[WaitPart]:
    start, end = wait.start, wait.until
    changes = _changes(run, keys, start, end)
    stops = sorted({time for time in changes if start < time < end})
    found: list[tuple[float, Holders]] = []
    for stop, after in pairwise([start, *stops, end]):
        if after - stop < _NO_TIME and (found or after < end):
            continue
        by = holders(RunAt(run, stop))
        if not found or not by.is_same_as(found[-1][1]):
            found.append((stop if found else start, by))
    ends = [*(since for since, _ in found[1:]), end]
    return [(since, until, by) for (since, by), until in zip(found, ends, strict=True)]
