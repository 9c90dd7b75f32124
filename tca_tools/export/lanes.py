"""Spans of time side by side in lanes, in none of which two overlap. Pure."""

import heapq
from collections.abc import Iterable, Sequence
from itertools import groupby
from math import inf
from operator import itemgetter
from typing import NamedTuple, TypeVar

T = TypeVar("T")

_MOST_WITHIN = 100
"""So many spans may lie within each other; Perfetto draws no more than 512."""


class Span(NamedTuple):
    """From when until when (None: it goes on); in nanoseconds."""

    start: int
    end: int | None

    @property
    def last(self) -> float:
        """Its end, however late."""
        return inf if self.end is None else self.end


def in_lanes(spans: Iterable[tuple[Span, T]]) -> list[list[tuple[Span, T]]]:
    """Each span, with what belongs to it, in the first lane that is free when it starts."""
    lanes: list[list[tuple[Span, T]]] = []
    busy: list[tuple[float, int]] = []
    free: list[int] = []
    for span, thing in sorted(spans, key=lambda pair: pair[0].start):
        while busy and busy[0][0] <= span.start:
            heapq.heappush(free, heapq.heappop(busy)[1])
        lane = heapq.heappop(free) if free else len(lanes)
        if lane == len(lanes):
            lanes.append([])
        lanes[lane].append((span, thing))
        heapq.heappush(busy, (span.last, lane))
    return lanes


def nested(spans: Iterable[tuple[Span, T]]) -> tuple[list[tuple[Span, T]], list[tuple[Span, T]]]:
    """Those that lie within each other or apart, outermost first; and the others, which overlap one of them, or are
    within too many.
    """
    fitting: list[tuple[Span, T]] = []
    others: list[tuple[Span, T]] = []
    around: list[Span] = []
    for span, thing in sorted(spans, key=lambda pair: (pair[0].start, -pair[0].last)):
        while around and around[-1].last <= span.start:
            around.pop()
        fits = not around or (span.last <= around[-1].last and len(around) < _MOST_WITHIN)
        (fitting if fits else others).append((span, thing))
        if fits:
            around.append(span)
    return fitting, others


def levels(spans: Sequence[Span]) -> list[tuple[int, int]]:
    """How many of the spans there are at a time, from when on: only where the number changes."""
    steps = [(span.start, 1) for span in spans]
    steps += [(span.end, -1) for span in spans if span.end is not None]
    found: list[tuple[int, int]] = []
    level = 0
    for time, group in groupby(sorted(steps), key=itemgetter(0)):
        change = sum(step for _, step in group)
        if change or not found:
            level += change
            found.append((time, level))
    return found
