"""Spans of nanoseconds side by side in lanes, in none of which two overlap, or within each other. Pure."""

from collections import defaultdict
from collections.abc import Iterable
from math import inf
from typing import NamedTuple, TypeVar

from tca_tools.spans import lanes

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
    found: dict[int, list[tuple[Span, T]]] = defaultdict(list)
    ordered = sorted(spans, key=lambda pair: pair[0].start)
    for pair, lane in zip(ordered, lanes((span.start, span.last) for span, _ in ordered), strict=True):
        found[lane].append(pair)
    return list(found.values())


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
