"""How busy each resource was, and how long its queue. Pure."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from operator import attrgetter

from tca_tools.run.records import Claim, Handling, Queueing
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover, Span, levels
from tca_wire.text.facts_in_words import place

Key = tuple[str, str]
"""A module and one of its resources."""
_BEFORE = 100
"""Locks that are looked at, of those that were asked for before a wait began."""


@dataclass(frozen=True, slots=True)
class Busy:
    """How busy a resource was between two times. All tools ask here."""

    seconds: float
    """How long its slots had messages, all slots together."""
    waiting: float
    """How much of that the handlers waited for replies, tasks or locks; of one handler what overlaps counts once."""
    share: float
    """The seconds as a share of what its slots had to give (0 to 1)."""


@dataclass(slots=True)
class Use:
    """What a resource did between two times; all lengths in seconds."""

    key: Key
    name: str
    capacity: int
    handled: int
    """How many messages it was given."""
    busy: float
    """How long its slots had messages, all slots together."""
    waiting: float
    """How much of that the handlers waited for replies, tasks or locks."""
    share: float
    """*busy* as a share of what its slots had to give (0 to 1)."""
    full: float
    """How long all its slots had messages."""
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
    found = [_use(run, key, handled.get(key, []), queued.get(key, []), start, end) for key in handled | queued]
    return sorted(found, key=lambda use: (-use.share, -use.queue_seconds, use.key))


def capacity_of(run: Run, key: Key) -> int:
    """The largest capacity that a resource had; 1 if the journal does not say."""
    module = run.modules.get(key[0])
    return max(module.capacities.get(key[1], 1), 1) if module else 1


def busy(runs: list[Handling], capacity: int, start: float, end: float) -> Busy:
    """How busy a resource of a capacity was with these runs of its handlers."""
    handled = lengths(clipped(run.start, run.end, start, end) for run in runs)
    waited = sum(
        Cover(clipped(wait.start, wait.end, start, end) for wait in run.waits).total for run in runs if run.waits
    )
    given = max(capacity, 1) * (end - start)
    return Busy(handled, waited, min(handled / given, 1.0) if given > 0 else 0.0)


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
        until = run.time if claim.end is None else claim.end
        is_own = claim is but or (claim.is_reserved and claim.sender == sender)
        if since is not None and until > start and not is_own:
            spans.append((since, until))
            by = claim if by is None or by.granted is None or claim.granted else by
    return Cover(spans).within(start, end), by


def _use(run: Run, key: Key, handled: list[Handling], queued: list[Queueing], start: float, end: float) -> Use:
    runs = [clipped(handling.start, handling.end, start, end) for handling in handled]
    lines = [clipped(queueing.start, queueing.end, start, end) for queueing in queued]
    grants = run.granted(*key)
    locks = [clipped(claim.granted or claim.start, claim.end, start, end) for claim in grants]
    capacity = capacity_of(run, key)
    had = busy(handled, capacity, start, end)
    longest_queue = max((count for _, count in levels(lines)), default=0)
    longest_wait = max((until - since for since, until in lines), default=0.0)
    return Use(
        key, place(*key), capacity, len(handled), had.seconds, had.waiting, had.share, Cover(runs, capacity).total,
        len(queued), lengths(lines), longest_queue, longest_wait, Cover(locks).total, (start, end),
    )  # fmt: skip


def clipped(since: float, until: float | None, start: float, end: float) -> Span:
    """The part of a span that lies between *start* and *end*; a span that goes on (None) is taken until *end*."""
    return min(max(since, start), end), end if until is None else max(min(until, end), start)


def lengths(spans: Iterable[Span]) -> float:
    """How long they are together, in seconds."""
    return sum(max(until - since, 0.0) for since, until in spans)
