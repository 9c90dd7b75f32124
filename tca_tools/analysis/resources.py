"""The use of each resource, its queue, and the queues that only grow. Pure."""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import ceil, sqrt
from operator import attrgetter
from typing import NamedTuple, TypeVar

from tca_tools.journal.records import Claim, Handling, Queueing
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, Span, levels, most_at_once
from tca_wire.text.facts_in_words import place

Key = tuple[str, str]
"""A module and one of its resources."""
_T = TypeVar("_T", Handling, Queueing)
_MOST_EARLIER = 100
"""The number of earlier claims that are checked for each wait."""


@dataclass(slots=True)
class Use:
    """The use of a resource between two times; all durations in seconds. All tools use this."""

    key: Key
    name: str
    capacity: int
    handled: int
    """The number of deliveries to it."""
    busy: float
    """How long its slots had messages, summed over the slots."""
    waiting: float
    """The part of ``busy`` in which handlers waited; overlapping waits of a handler count once."""
    share: float
    """``busy`` as a share of the time of all slots (0 to 1)."""
    queued: int
    """The number of messages that were queued for it."""
    queue_seconds: float
    """How long they were queued, summed."""
    longest_queue: int
    """The largest number of queued messages at a time."""
    longest_wait: float
    """The longest wait of a message in the queue."""
    locked: float
    """How long it was locked or reserved."""
    window: Span
    """The two times."""

    @property
    def worked(self) -> float:
        """How long its handlers had a message and did not wait."""
        return max(self.busy - self.waiting, 0.0)


def uses(run: Run, start: float, end: float) -> list[Use]:
    """Return the use of each resource that handled or queued something, the busiest first.

    Args:
        run: The run.
        start: The start of the window, in seconds.
        end: The end of the window, in seconds.
    """
    handled, queued = _by_resource(run.handlings), _by_resource(run.queueings)
    window = start, end
    found = (
        _use(run, key, handled.get(key, []), queued.get(key, []), window)
        for key in handled | queued
    )
    return sorted(found, key=lambda use: (-use.share, -use.queue_seconds, use.key))


def _by_resource(spans: Iterable[_T]) -> dict[Key, list[_T]]:
    """Group spans by resource; spans without a module are left out."""
    found: dict[Key, list[_T]] = {}
    for one in spans:
        if one.module:
            found.setdefault((one.module, one.resource), []).append(one)
    return found


def capacity_of(run: Run, key: Key) -> int:
    """Return the largest capacity that a resource had; 1 if it is unknown."""
    module = run.modules.get(key[0])
    return max(module.capacities.get(key[1], 1), 1) if module else 1


def locked_out(
    run: Run, key: Key, start: float, end: float, sender: str = "", but: Claim | None = None
) -> tuple[float, Claim | None]:
    """Return for how many seconds of a wait a resource was blocked by claims, and by which one.

    That is the last granted claim, or the last pending one if none was granted. A granted claim
    blocks the resource in all copies of its module. So does a pending claim that was requested
    before the wait.

    Args:
        run: The run.
        key: The resource.
        start: The start of the wait.
        end: The end of the wait.
        sender: The module whose own reservations do not count.
        but: A claim that does not count.
    """
    claims = run.requested_claims(*key)
    first, last = (bisect_right(claims, time, key=attrgetter("start")) for time in (start, end))
    spans, by = list[Span](), None
    for claim in claims[max(first - _MOST_EARLIER, 0) : last]:
        since = claim.start if claim.start <= start else claim.granted
        until = min(claim.until, run.time)
        is_own = claim is but or (claim.is_reserved and claim.sender == sender)
        if since is not None and until > start and not is_own:
            spans.append((since, until))
            by = claim if by is None or by.granted is None or claim.granted else by
    return Cover(spans).within(start, end), by


def _use(run: Run, key: Key, handled: list[Handling], queued: list[Queueing], window: Span) -> Use:
    start, end = window

    def clipped(spans: Iterable[Span]) -> list[Span]:
        return [
            (min(max(since, start), end), max(min(until, end), start)) for since, until in spans
        ]

    capacity = capacity_of(run, key)
    busy = _total_seconds(clipped((one.start, one.until) for one in handled))
    waiting = sum(Cover(clipped(_waits_in(one))).total for one in handled if one.waits)
    share = min(busy / (capacity * (end - start)), 1.0) if end > start else 0.0
    queue_spans = clipped((one.start, one.until) for one in queued)
    return Use(
        key=key,
        name=place(*key),
        capacity=capacity,
        handled=len(handled),
        busy=busy,
        waiting=waiting,
        share=share,
        queued=len(queued),
        queue_seconds=_total_seconds(queue_spans),
        longest_queue=most_at_once(queue_spans),
        longest_wait=max((until - since for since, until in queue_spans), default=0.0),
        locked=Cover(clipped(_locked_while_there(run, key))).total,
        window=window,
    )


def _waits_in(handling: Handling) -> Iterator[Span]:
    """Yield the waits of a handler, cut off at its return."""
    for wait in handling.waits:
        if wait.start < (end := min(wait.until, handling.until)):
            yield wait.start, end


def _locked_while_there(run: Run, key: Key) -> Iterator[Span]:
    """Yield the spans in which a resource was locked and its module, or a copy of it, connected."""
    module = run.modules.get(key[0])
    joined = (module.joined if module is not None else ()) or [(0.0, None)]
    for claim in run.granted(*key):
        for since, until in joined:
            start = max(claim.granted or claim.start, since)
            end = claim.until if until is None else min(claim.until, until)
            if end > start:
                yield start, end


def _total_seconds(spans: list[Span]) -> float:
    """Return the sum of the durations of spans, in seconds."""
    return sum(max(until - since, 0.0) for since, until in spans)


# --- queues that only grow ------------------------------------------------------------------------

# The window starts when the queue was last empty, and ends at the last arrival or delivery. A queue
# counts as growing if the window is long, if the queue grew in both halves of it, and if the
# resource handled messages in it. This excludes bursts, steady queues, and hanging handlers.

_LEAST_LENGTH = 5
"""The least length of a growing queue."""
_LEAST_HANDLED = 3
"""The least number of messages handled while it grows."""
_LEAST_GROWTH = 0.1
"""The least surplus of arrivals, as a share of the messages handled."""
_LEAST_DEVIATIONS = 3
"""The least surplus in standard deviations: n random arrivals vary by the square root of n."""
_LEAST_SHARE = 0.2
"""The least duration of growth, as a share of the run."""


class GrowingQueue(NamedTuple):
    """A queue that grew until the end."""

    key: Key
    capacity: int
    start: float
    """When it was last empty."""
    end: float
    """The time of the last arrival or delivery."""
    length: int
    """Its length at the end."""
    rate_in: float
    """Arrivals per second."""
    rate_out: float
    """Messages handled per second."""
    longest: float
    """The wait of the oldest message at the end, in seconds."""
    message: str
    """The most frequent message name in the queue."""

    @property
    def needed(self) -> int:
        """The number of slots that could handle the arrivals, at the rate of the present slots."""
        return ceil(self.capacity * self.rate_in / self.rate_out)


def growing_queues(run: Run, start: float, end: float) -> list[GrowingQueue]:
    """Return the growing queues of a run that lasted from *start* to *end*."""
    least, found = _LEAST_SHARE * (end - start), list[GrowingQueue]()
    for key, queued in _by_resource(run.queueings).items():
        one = _growing(run, key, queued) if len(queued) >= _LEAST_LENGTH else None
        if one is not None and one.end - one.start >= least:
            found.append(one)
    return found


def _growing(run: Run, key: Key, queued: list[Queueing]) -> GrowingQueue | None:
    deliveries = [handling.start for handling in run.by_resource.get(key, [])]
    end = max([queued[-1].start, *deliveries[-1:]])
    late = (one for one in queued if one.until >= end)
    left = [one for one in late if one.until > end or not _was_delivered(run, one)]
    if len(left) < _LEAST_LENGTH:
        return None
    start, middle = _growth(queued, left, end)
    handled = sum(time > start for time in deliveries)
    grew_in_both_halves = len(left) / 4 <= middle <= len(left) * 3 / 4
    exceeds_chance = len(left) >= max(_LEAST_GROWTH * handled, _LEAST_DEVIATIONS * sqrt(handled))
    if (
        not grew_in_both_halves
        or not exceeds_chance
        or handled < _LEAST_HANDLED
        or run.granted(*key)
    ):
        return None
    names, length = Counter(run.name(one.message_id) for one in left), len(left)
    rates = ((handled + length) / (end - start), handled / (end - start))
    longest, (message, _) = end - min(one.start for one in left), names.most_common(1)[0]
    return GrowingQueue(key, capacity_of(run, key), start, end, length, *rates, longest, message)


def _was_delivered(run: Run, queueing: Queueing) -> bool:
    """Whether a queued message was delivered to a handler."""
    message = run.messages.get(queueing.message_id)
    handlings = message.handlings if message is not None else ()
    return any(handling.start == queueing.end for handling in handlings)


def _growth(queued: list[Queueing], left: list[Queueing], end: float) -> tuple[float, int]:
    """Return when a queue was last empty, and its length halfway from then to the end."""
    left_ids, later = {id(one) for one in left}, end + 1.0
    spans = [(one.start, later if id(one) in left_ids else min(one.until, later)) for one in queued]
    lengths = [(time, length) for time, length in levels(spans) if time <= end]
    start = max((time for time, length in lengths if not length), default=None)
    start = next(time for time, _ in lengths if start is None or time > start)
    middle = (start + end) / 2
    return start, [length for time, length in lengths if time <= middle][-1]
