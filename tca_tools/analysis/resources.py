"""How busy each resource was, and how long its queue. Pure."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from operator import attrgetter

from tca_tools.journal.records import Claim, Handling, Queueing
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, Span, most_at_once
from tca_wire.text.facts_in_words import place

Key = tuple[str, str]
"""A module and one of its resources."""
_BEFORE = 100
"""Locks that are looked at, of those that were asked for before a wait began."""


@dataclass(slots=True)
class Use:
    """The use of a resource between two times; all lengths in seconds. All tools ask here."""

    key: Key
    name: str
    capacity: int
    handled: int
    """How many messages it was given."""
    busy: float
    """How long its slots had messages, all slots together."""
    waiting: float
    """How much of that the handlers waited for replies, tasks or locks; of one handler what overlaps counts once."""
    share: float
    """*busy* as a share of what its slots had to give (0 to 1)."""
    queued: int
    """How many messages stood in its queue at some time."""
    queue_seconds: float
    """How long they stood there, all together."""
    longest_queue: int
    longest_wait: float
    locked: float
    """How long it was locked or reserved."""
    window: Span
    """The two times."""

    @property
    def worked(self) -> float:
        """How long its handlers had a message and waited for nothing."""
        return max(self.busy - self.waiting, 0.0)


def uses(run: Run, start: float, end: float) -> list[Use]:
    """Each resource that handled or queued something between *start* and *end*, the busiest first."""
    handled: dict[Key, list[Handling]] = {}
    for handling in run.handlings:
        handled.setdefault((handling.module, handling.resource), []).append(handling)
    queued: dict[Key, list[Queueing]] = {}
    for queueing in run.queueings:
        if queueing.module:
            queued.setdefault((queueing.module, queueing.resource), []).append(queueing)
    window = start, end
    found = (_use(run, key, handled.get(key, []), queued.get(key, []), window) for key in handled | queued)
    return sorted(found, key=lambda use: (-use.share, -use.queue_seconds, use.key))


def capacity_of(run: Run, key: Key) -> int:
    """The largest capacity that a resource had; 1 if the journal does not say."""
    module = run.modules.get(key[0])
    return max(module.capacities.get(key[1], 1), 1) if module else 1


def kept_out(
    run: Run, key: Key, start: float, end: float, sender: str = "", but: Claim | None = None
) -> tuple[float, Claim | None]:
    """How many seconds of a wait for a resource were because of locks and reservations, and the last of these: those in
    force, in any copy of the module, and those that somebody who had come before waited for. What is reserved by the
    sender does not keep it out.
    """
    claims = run.asked_for(*key)
    first, last = (bisect_right(claims, time, key=attrgetter("start")) for time in (start, end))
    spans, by = list[Span](), None
    for claim in claims[max(first - _BEFORE, 0) : last]:
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
        return [(min(max(since, start), end), max(min(until, end), start)) for since, until in spans]

    capacity = capacity_of(run, key)
    busy = _length(clipped((one.start, one.until) for one in handled))
    waiting = sum(Cover(clipped(_waits_in(one))).total for one in handled if one.waits)
    share = min(busy / (capacity * (end - start)), 1.0) if end > start else 0.0
    lines = clipped((one.start, one.until) for one in queued)
    return Use(
        key=key,
        name=place(*key),
        capacity=capacity,
        handled=len(handled),
        busy=busy,
        waiting=waiting,
        share=share,
        queued=len(queued),
        queue_seconds=_length(lines),
        longest_queue=most_at_once(lines),
        longest_wait=max((until - since for since, until in lines), default=0.0),
        locked=Cover(clipped(_locked_while_there(run, key))).total,
        window=window,
    )


def _waits_in(handling: Handling) -> Iterator[Span]:
    """The waits of a handler, until it returned: a program may give one up later."""
    for wait in handling.waits:
        if wait.start < (end := min(wait.until, handling.until)):
            yield wait.start, end


def _locked_while_there(run: Run, key: Key) -> Iterator[Span]:
    """When a resource was locked. A lock is one of all copies of a module: of each as long as it was connected."""
    module = run.modules.get(key[0])
    joined = (module.joined if module is not None else ()) or [(0.0, None)]
    for claim in run.granted(*key):
        for since, until in joined:
            start = max(claim.granted or claim.start, since)
            end = claim.until if until is None else min(claim.until, until)
            if end > start:
                yield start, end


def _length(spans: list[Span]) -> float:
    """How long they are together, in seconds."""
    return sum(max(until - since, 0.0) for since, until in spans)
