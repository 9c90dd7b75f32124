"""The parts of a trace: tracks, and events on them.

Perfetto has these rules (perfetto.dev, "Writing TrackEvent Protos Synthetically"). Slices of one
track are nested or disjoint, and an end closes the slice that started last. Overlapping slices need
several tracks. The page shows siblings of one name as one track. A flow is an arrow from slice to
slice, in the order of their times.
"""

import heapq
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import inf
from operator import itemgetter
from typing import Any, NamedTuple, TypeVar

from tca_tools.export.nanoseconds import Nanoseconds
from tca_tools.journal.whole_run import Run
from tca_tools.spans import lanes, levels

T = TypeVar("T")
Details = dict[str, Any]


class TraceSpan(NamedTuple):
    """A span in nanoseconds; the end is None if it has not ended."""

    start: int
    end: int | None

    @property
    def last(self) -> float:
        """Its end; infinity if it has not ended."""
        return inf if self.end is None else self.end


class EventKind(IntEnum):
    """The kind of an event; the numbers are Perfetto's."""

    BEGIN = 1
    END = 2
    INSTANT = 3
    COUNTER = 4


class Event(NamedTuple):
    """An event on a track. Events are sorted by their first three fields."""

    time: int
    """The time in nanoseconds."""
    is_arrival: bool
    """Whether an arrow leads to this event.

    If so, it comes after the other events of the same time, since the arrow may start at one.
    """
    track: int
    kind: EventKind
    name: str = ""
    category: str = ""
    details: Details | None = None
    """The details that the page shows when the event is clicked; None values are left out."""
    flows: Sequence[int] = ()
    value: int = 0
    """The value of a counter."""


@dataclass(slots=True)
class Track:
    """A line of the page."""

    trace: "Trace"
    uuid: int
    name: str
    parent: int
    """The uuid of its parent track; 0 for none."""
    rank: int
    """Its place among its siblings."""
    is_counter: bool
    events: Iterable[Event] = ()

    def begin(
        self,
        span: TraceSpan,
        name: str,
        category: str,
        details: Details | None = None,
        flow: int | None = None,
    ) -> Event:
        """Return the start of a slice; *flow* is the arrow that leads to it."""
        flows = [flow] if flow else []
        return Event(
            span.start, flow is not None, self.uuid, EventKind.BEGIN, name, category, details, flows
        )

    def instant(
        self, time: int, name: str, category: str, details: Details, flows: Sequence[int] = ()
    ) -> Event:
        """Return an event without duration; *flows* are the arrows that start here."""
        return Event(time, False, self.uuid, EventKind.INSTANT, name, category, details, flows)

    def slices(self, spans: Iterable[tuple[TraceSpan, Event]]) -> Iterator[Event]:
        """Yield the events of slices, given their spans and starts.

        The spans are nested or disjoint, and sorted by start, the outer ones first.
        """
        around: list[TraceSpan] = []
        for span, event in spans:
            while around and around[-1].last <= span.start:
                yield from self._end(around.pop())
            yield event
            around.append(span)
        while around:
            yield from self._end(around.pop())

    def within(self, span: TraceSpan, outer: Event, *inside: Iterable[Event]) -> Iterator[Event]:
        """Yield a slice with the events in it; at equal times, earlier arguments come first."""
        yield outer
        yield from in_order(*inside)
        yield from self._end(span)

    def counter(self, spans: Iterable[TraceSpan]) -> Iterator[Event]:
        """Yield a counter event at each change of the number of spans that contain the time."""
        for time, number in levels((span.start, span.last) for span in spans):
            if time < inf:
                yield Event(int(time), False, self.uuid, EventKind.COUNTER, value=number)

    def _end(self, span: TraceSpan) -> Iterator[Event]:
        if span.end is not None:
            yield Event(span.end, False, self.uuid, EventKind.END)


class Trace:
    """A trace: a collection of tracks."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.nanoseconds = Nanoseconds(run)
        self.tracks: list[Track] = []
        self._ranks: dict[tuple[int, str], int] = {}

    def add(
        self, name: str, parent: Track | None = None, rank: int = 0, *, is_counter: bool = False
    ) -> Track:
        """Add a track without events, and return it.

        The page shows siblings of equal name and rank as one. A track with the name of a sibling
        of another rank is renamed.
        """
        above = parent.uuid if parent else 0
        while self._ranks.setdefault((above, name), rank) != rank:
            name += " (another)"
        track = Track(self, len(self.tracks) + 1, name, above, rank, is_counter)
        self.tracks.append(track)
        return track

    def span(self, start: float, end: float | None) -> TraceSpan:
        """Return a span of seconds in nanoseconds."""
        first = self.nanoseconds(start)
        return TraceSpan(first, None if end is None else max(self.nanoseconds(end), first))

    def events(self) -> Iterator[Event]:
        """Yield all events in the order of time. Events of one track keep their own order."""
        return heapq.merge(*(track.events for track in self.tracks))


def in_order(*events: Iterable[Event]) -> Iterator[Event]:
    """Merge the events of a track by time; at equal times, earlier arguments come first."""
    return heapq.merge(*events, key=itemgetter(0))


def in_lanes(spans: Iterable[tuple[TraceSpan, T]]) -> list[list[tuple[TraceSpan, T]]]:
    """Assign each span to the first lane that is free when it starts.

    Return the lanes, each with its spans and their objects.
    """
    found: dict[int, list[tuple[TraceSpan, T]]] = defaultdict(list)
    ordered = sorted(spans, key=lambda pair: pair[0].start)
    for pair, lane in zip(
        ordered, lanes((span.start, span.last) for span, _ in ordered), strict=True
    ):
        found[lane].append(pair)
    return list(found.values())
