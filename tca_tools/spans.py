"""Spans of time: their lanes, their number at a time, and their cover of a window. Pure."""

import heapq
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import accumulate
from math import inf
from operator import itemgetter
from typing import Generic, TypeVar

Span = tuple[float, float]
_T = TypeVar("_T")


class Cover:
    """The times at which at least *at_least* spans are active.

    ``within`` returns the sum of these times in any window, in O(log n).
    """

    def __init__(self, spans: Iterable[Span], at_least: int = 1) -> None:
        self._starts: list[float] = []
        self._ends: list[float] = []
        since, last = 0.0, 0
        for time, count in levels(spans):
            if last < at_least <= count:
                since = time
            elif count < at_least <= last and time > since:
                self._starts.append(since)
                self._ends.append(time)
            last = count
        lengths = (end - start for start, end in zip(self._starts, self._ends, strict=True))
        self._before = [0.0, *accumulate(lengths)]

    @property
    def total(self) -> float:
        """The sum of the covered times, in seconds."""
        return self._before[-1]

    def within(self, start: float, end: float) -> float:
        """Return the sum of the covered times in a window, in seconds."""
        return self._until(end) - self._until(start) if end > start else 0.0

    def _until(self, time: float) -> float:
        place = bisect_right(self._starts, time)
        if not place:
            return 0.0
        return self._before[place] - max(self._ends[place - 1] - time, 0.0)


class Lanes:
    """Lanes in which spans do not overlap. A span gets the first lane that is free at its start."""

    def __init__(self) -> None:
        self._ends: list[float] = []
        """The end of the last span in each lane; inf while it is unknown."""
        self._busy: list[tuple[float, int]] = []
        """The known ends of spans, with their lanes; a heap."""
        self._free: list[int] = []
        """The free lanes; a heap."""

    def assign(self, start: float) -> int:
        """Return a lane for a span that starts at a time."""
        while self._busy and self._busy[0][0] <= start:
            heapq.heappush(self._free, heapq.heappop(self._busy)[1])
        if self._free and self._ends[self._free[0]] <= start:
            return heapq.heappop(self._free)
        # A span that is reported late may start before some of the free lanes became free
        for lane in sorted(self._free):
            if self._ends[lane] <= start:
                self._free.remove(lane)
                heapq.heapify(self._free)
                return lane
        self._ends.append(inf)
        return len(self._ends) - 1

    def release(self, lane: int, end: float) -> None:
        """Set the end of the last span in a lane."""
        self._ends[lane] = end
        heapq.heappush(self._busy, (end, lane))


def lanes(spans: Iterable[Span]) -> Iterator[int]:
    """Yield the lane of each span; the spans are sorted by their starts."""
    found = Lanes()
    for start, end in spans:
        lane = found.assign(start)
        found.release(lane, end)
        yield lane


def levels(spans: Iterable[Span]) -> Iterator[tuple[float, int]]:
    """Yield the number of active spans at each time at which it changes."""
    changes = defaultdict[float, int](int)
    for start, end in spans:
        if end > start:
            changes[start] += 1
            changes[end] -= 1
    count = 0
    for time, change in sorted(changes.items()):
        if change:
            count += change
            yield time, count


def most_at_once(spans: Iterable[Span]) -> int:
    """Return the largest number of spans active at a time."""
    return max((count for _, count in levels(spans)), default=0)


class Overlaps(Generic[_T]):
    """Items with spans. ``within`` finds those active in a window, in O(log n) for each of them."""

    def __init__(self, things: Iterable[_T], span: Callable[[_T], Span]) -> None:
        spans = sorted(((*span(thing), thing) for thing in things), key=itemgetter(0))
        self._starts = [start for start, _, _ in spans]
        self._things = [thing for _, _, thing in spans]
        self._size = 1 << max(len(spans) - 1, 0).bit_length()
        last = [-inf] * (2 * self._size)
        last[self._size : self._size + len(spans)] = [end for _, end, _ in spans]
        for node in range(self._size - 1, 0, -1):
            last[node] = max(last[2 * node], last[2 * node + 1])
        # A binary tree: each node is the latest end of the items below it; node 1 is the root
        self._last = last

    def within(self, start: float, end: float) -> list[_T]:
        """Return the items that start by *end* and end after *start*, sorted by their starts."""
        begun, found = bisect_right(self._starts, end), list[_T]()
        rest = [(1, 0, self._size)]
        while rest:
            node, first, width = rest.pop()
            if first >= begun or self._last[node] <= start:
                continue
            if width == 1:
                found.append(self._things[first])
            else:
                width //= 2
                rest += ((2 * node + 1, first + width, width), (2 * node, first, width))
        return found
