"""Spans of time: lanes in which they have room, how many overlap, how much of a window they cover,
and which. Pure.
"""

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
    """Times at which at least *at_least* of some spans go on; of any window it tells, in O(log n),
    how much that is.
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
        """All of it, in seconds."""
        return self._before[-1]

    def within(self, start: float, end: float) -> float:
        """How many seconds of a window."""
        return self._until(end) - self._until(start) if end > start else 0.0

    def _until(self, time: float) -> float:
        place = bisect_right(self._starts, time)
        if not place:
            return 0.0
        return self._before[place] - max(self._ends[place - 1] - time, 0.0)


class Lanes:
    """Lanes, in each of which no spans overlap. A span gets the first that is free when it
    begins.
    """

    def __init__(self) -> None:
        self._ends: list[float] = []
        """When the last span of each ended, or will."""
        self._busy: list[tuple[float, int]] = []
        """Lanes with the ends of their spans, once these are known."""
        self._free: list[int] = []

    def assign(self, start: float) -> int:
        """A lane for what begins at that time."""
        while self._busy and self._busy[0][0] <= start:
            heapq.heappush(self._free, heapq.heappop(self._busy)[1])
        if self._free and self._ends[self._free[0]] <= start:
            return heapq.heappop(self._free)
        for lane in sorted(self._free):  # what is told late began before others ended
            if self._ends[lane] <= start:
                self._free.remove(lane)
                heapq.heapify(self._free)
                return lane
        self._ends.append(inf)
        return len(self._ends) - 1

    def release(self, lane: int, end: float) -> None:
        """Tell when the span of a lane ends."""
        self._ends[lane] = end
        heapq.heappush(self._busy, (end, lane))


def lanes(spans: Iterable[Span]) -> Iterator[int]:
    """The lane of each span, given in the order of their starts."""
    taken = Lanes()
    for start, end in spans:
        lane = taken.assign(start)
        taken.release(lane, end)
        yield lane


def levels(spans: Iterable[Span]) -> Iterator[tuple[float, int]]:
    """How many of the spans go on, from each time on at which that changes."""
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
    """How many of the spans go on at a time, at the most."""
    return max((count for _, count in levels(spans)), default=0)


class Overlaps(Generic[_T]):
    """Things with a start and an end; of any window it tells, in O(log n) for each, which of them
    go on in it.
    """

    def __init__(self, things: Iterable[_T], span: Callable[[_T], Span]) -> None:
        spans = sorted(((*span(thing), thing) for thing in things), key=itemgetter(0))
        self._starts = [start for start, _, _ in spans]
        self._things = [thing for _, _, thing in spans]
        self._size = 1 << max(len(spans) - 1, 0).bit_length()
        last = (
            [-inf] * self._size + [end for _, end, _ in spans] + [-inf] * (self._size - len(spans))
        )
        for node in range(self._size - 1, 0, -1):
            last[node] = max(last[2 * node], last[2 * node + 1])
        self._last = last  # a tree: each node has the last end of all below it, node 1 of all

    def within(self, start: float, end: float) -> list[_T]:
        """Those that begin until *end* and are over after *start*, as they begin."""
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
