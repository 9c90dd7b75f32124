"""The parts of a trace: tracks, and events on them. Knows nothing of what they show, nor of the
file's format.

Perfetto's rules (perfetto.dev, "Writing TrackEvent Protos Synthetically"): slices of one track lie
within each other or apart, an end closes the slice that was begun last, and what overlaps needs
tracks of its own; the page shows siblings of one name as one track. A flow is an arrow from slice
to slice, in the order of their times.
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
    """From when until when (None: it goes on); in nanoseconds."""

    start: int
    end: int | None

    @property
    def last(self) -> float:
        """Its end, however late."""
        return inf if self.end is None else self.end


class EventKind(IntEnum):
    """The kind of an event; the numbers are Perfetto's."""

    BEGIN = 1
    END = 2
    INSTANT = 3
    COUNTER = 4


class Event(NamedTuple):
    """Something on a track. Events are sorted by their first three fields."""

    time: int
    """In nanoseconds."""
    is_arrival: bool
    """Whether an arrow leads here: such an event comes after others of its time, where the arrow
    may begin.
    """
    track: int
    kind: EventKind
    name: str = ""
    category: str = ""
    details: Details | None = None
    """The details that the page shows when the event is clicked; None values are left out."""
    flows: Sequence[int] = ()
    value: int = 0
    """Of a counter."""


@dataclass(slots=True)
class Track:
    """A line of the page."""

    trace: "Trace"
    uuid: int
    name: str
    parent: int
    """The uuid of the track that it is under; 0: none."""
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
        """The begin of a slice; *flow* is the arrow that leads to it."""
        flows = [flow] if flow else []
        return Event(
            span.start, flow is not None, self.uuid, EventKind.BEGIN, name, category, details, flows
        )

    def instant(
        self, time: int, name: str, category: str, details: Details, flows: Sequence[int] = ()
    ) -> Event:
        """Something that takes no time; *flows* are the arrows that begin here."""
        return Event(time, False, self.uuid, EventKind.INSTANT, name, category, details, flows)

    def slices(self, spans: Iterable[tuple[TraceSpan, Event]]) -> Iterator[Event]:
        """Slices from their begins; the spans lie within each other or apart, and are sorted,
        outermost first.
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
        """A slice with what is inside it; of events of one time, those of the first come first."""
        yield outer
        yield from in_order(*inside)
        yield from self._end(span)

    def counter(self, spans: Iterable[TraceSpan]) -> Iterator[Event]:
        """How many of the spans there are at a time: an event wherever that changes."""
        for time, number in levels((span.start, span.last) for span in spans):
            if time < inf:
                yield Event(int(time), False, self.uuid, EventKind.COUNTER, value=number)

    def _end(self, span: TraceSpan) -> Iterator[Event]:
        if span.end is not None:
            yield Event(span.end, False, self.uuid, EventKind.END)


class Trace:
    """Tracks in the making."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.nanoseconds = Nanoseconds(run)
        self.tracks: list[Track] = []
        self._ranks: dict[tuple[int, str], int] = {}

    def add(
        self, name: str, parent: Track | None = None, rank: int = 0, *, is_counter: bool = False
    ) -> Track:
        """A new track without events. Siblings of one name and rank are shown as one; of another
        rank it is renamed.
        """
        above = parent.uuid if parent else 0
        while self._ranks.setdefault((above, name), rank) != rank:
            name += " (another)"
        track = Track(self, len(self.tracks) + 1, name, above, rank, is_counter)
        self.tracks.append(track)
        return track

    def span(self, start: float, end: float | None) -> TraceSpan:
        """A span of seconds in nanoseconds."""
        first = self.nanoseconds(start)
        return TraceSpan(first, None if end is None else max(self.nanoseconds(end), first))

    def events(self) -> Iterator[Event]:
        """All events, in the order of time; those of one track in their own order."""
        return heapq.merge(*(track.events for track in self.tracks))


def in_order(*events: Iterable[Event]) -> Iterator[Event]:
    """Events of one track by time; of those of one time, the first argument's come first."""
    return heapq.merge(*events, key=itemgetter(0))


def in_lanes(spans: Iterable[tuple[TraceSpan, T]]) -> list[list[tuple[TraceSpan, T]]]:
    """Each span, with what belongs to it, in the first lane that is free when it starts. In a lane
    none overlap.
    """
    found: dict[int, list[tuple[TraceSpan, T]]] = defaultdict(list)
    ordered = sorted(spans, key=lambda pair: pair[0].start)
    for pair, lane in zip(
        ordered, lanes((span.start, span.last) for span, _ in ordered), strict=True
    ):
        found[lane].append(pair)
    return list(found.values())
