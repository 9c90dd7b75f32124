"""Queues that only grow: more messages come for a resource than it handles. Pure.

Looked at is the time since the queue was last empty, until it was given or sent the last message. It counts if it is
long, if the queue has grown in both halves of it, and if the resource did handle messages meanwhile: a burst that is
worked off, a queue that is always about as long, and a handler that hangs are something else.
"""

from collections import Counter
from math import ceil, sqrt
from typing import NamedTuple

from tca_tools.analysis.resources import Key, capacity_of
from tca_tools.journal.records import Queueing
from tca_tools.journal.whole_run import Run
from tca_tools.spans import levels

_LENGTH = 5
"""A shorter queue is no sign."""
_HANDLED = 3
_GROWTH = 0.1
"""So much more must come than is handled, as a share of that."""
_CHANCE = 3
"""And so many times what chance makes of it: of n that come at random, the square root of n more or less."""
_SHARE = 0.2
"""It must have grown for so long, as a share of the run."""


class Growing(NamedTuple):
    """A queue that grew until the end."""

    key: Key
    capacity: int
    start: float
    """Since when it was not empty."""
    end: float
    """When the resource was given or sent its last message."""
    length: int
    """How many stood in it then."""
    rate_in: float
    """How many came a second."""
    rate_out: float
    """How many were handled a second."""
    longest: float
    """How long the oldest of the queue had waited at the end, in seconds."""
    message: str
    """The commonest message of the queue."""

    @property
    def needed(self) -> int:
        """How many slots would keep up, if one more slot handles as much as those there are."""
        return ceil(self.capacity * self.rate_in / self.rate_out)


def growing(run: Run, start: float, end: float) -> list[Growing]:
    """All such queues of a run that lasted from *start* to *end*."""
    lines: dict[Key, list[Queueing]] = {}
    for queueing in run.queueings:
        if queueing.module:
            lines.setdefault((queueing.module, queueing.resource), []).append(queueing)
    least, found = _SHARE * (end - start), list[Growing]()
    for key, queued in lines.items():
        one = _growing(run, key, queued) if len(queued) >= _LENGTH else None
        if one is not None and one.end - one.start >= least:
            found.append(one)
    return found


def _growing(run: Run, key: Key, queued: list[Queueing]) -> Growing | None:
    given = [handling.start for handling in run.runs.get(key, [])]
    end = max([queued[-1].start, *given[-1:]])
    late = (one for one in queued if one.until >= end)
    left = [one for one in late if one.until > end or not _was_given(run, one)]
    if len(left) < _LENGTH:
        return None
    start, middle = _growth(queued, left, end)
    handled = sum(time > start for time in given)
    is_steady = len(left) / 4 <= middle <= len(left) * 3 / 4
    is_more = len(left) >= max(_GROWTH * handled, _CHANCE * sqrt(handled))
    if not is_steady or not is_more or handled < _HANDLED or run.granted(*key):
        return None
    names, length = Counter(run.name(one.message_id) for one in left), len(left)
    rates = ((handled + length) / (end - start), handled / (end - start))
    longest, (message, _) = end - min(one.start for one in left), names.most_common(1)[0]
    return Growing(key, capacity_of(run, key), start, end, length, *rates, longest, message)


def _was_given(run: Run, queueing: Queueing) -> bool:
    """Whether a wait ended with a handler that got the message."""
    message = run.messages.get(queueing.message_id)
    handlings = message.handlings if message is not None else ()
    return any(handling.start == queueing.end for handling in handlings)


def _growth(queued: list[Queueing], left: list[Queueing], end: float) -> tuple[float, int]:
    """Since when the queue was not empty, and how long it was in the middle of that time."""
    stays, later = {id(one) for one in left}, end + 1.0
    spans = [(one.start, later if id(one) in stays else min(one.until, later)) for one in queued]
    lengths = [(time, length) for time, length in levels(spans) if time <= end]
    start = max((time for time, length in lengths if not length), default=None)
    start = next(time for time, _ in lengths if start is None or time > start)
    middle = (start + end) / 2
    return start, [length for time, length in lengths if time <= middle][-1]
