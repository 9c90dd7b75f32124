"""A reader of Perfetto traces. It reads a trace as Perfetto's trace processor does, but fails where
the trace processor only counts an error.

The rules come from perfetto.dev ("Writing TrackEvent Protos Synthetically") and from the trace
processor's slice, flow and track trackers. The classes are the published ones.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from perfetto.protos.perfetto.trace.perfetto_trace_pb2 import Trace, TrackEvent

BEGIN, END, INSTANT, COUNTER = (
    getattr(TrackEvent, f"TYPE_{name}")
    for name in ("SLICE_BEGIN", "SLICE_END", "INSTANT", "COUNTER")
)
DEEPEST_TRACK, DEEPEST_SLICE = 10, 512


@dataclass
class Slice:
    """A slice, or an instant if its duration is 0. An open slice has no *end*."""

    track: str
    name: str
    category: str
    start: int
    end: int | None
    parent: "Slice | None"
    details: dict[str, Any]
    lane: int

    @property
    def depth(self) -> int:
        return 0 if self.parent is None else self.parent.depth + 1


@dataclass
class Read:
    """The tables of the trace processor."""

    tracks: dict[int, Any] = field(default_factory=dict)
    slices: list[Slice] = field(default_factory=list)
    counters: dict[str, list[tuple[int, int]]] = field(default_factory=lambda: defaultdict(list))
    flows: dict[int, list[Slice]] = field(default_factory=lambda: defaultdict(list))
    clocks: dict[int, int] = field(default_factory=dict)

    def path(self, uuid: int) -> str:
        track, names = self.tracks[uuid], []
        while track is not None:
            names.append(track.name)
            assert len(names) <= DEEPEST_TRACK, "too many ancestors"
            track = self.tracks[track.parent_uuid] if track.parent_uuid else None
        return " > ".join(reversed(names))

    def on(self, track: str) -> list[Slice]:
        return [one for one in self.slices if one.track == track]

    def arrows(self) -> list[tuple[Slice, Slice]]:
        """Return the pairs of slices that arrows connect, in order of time."""
        return [pair for stations in self.flows.values() for pair in pairwise(stations)]


class Reader:
    def __init__(self) -> None:
        self.read = Read()
        self._names: dict[str, dict[int, str]] = defaultdict(dict)
        self._stacks: dict[int, list[Slice]] = defaultdict(list)
        self._time = 0
        self._sequence = 0
        self._has_events = False

    def packet(self, packet: Any) -> None:
        if not self._sequence:
            assert packet.first_packet_on_sequence
            assert packet.sequence_flags == 3  # incremental state cleared and needed
            self._sequence = packet.trusted_packet_sequence_id
        else:
            assert packet.sequence_flags == 2
        assert packet.trusted_packet_sequence_id == self._sequence != 0
        for kind in ("event_names", "event_categories", "debug_annotation_names"):
            for written in getattr(packet.interned_data, kind):
                assert written.iid > 0
                assert written.iid not in self._names[kind], "a name is written once"
                self._names[kind][written.iid] = written.name
        match packet.WhichOneof("data"):
            case "clock_snapshot":
                self.read.clocks = {
                    clock.clock_id: clock.timestamp for clock in packet.clock_snapshot.clocks
                }
            case "track_descriptor":
                self._track(packet.track_descriptor)
            case "track_event":
                self._event(packet.timestamp, packet.track_event)
            case other:
                raise AssertionError(other)

    def _track(self, track: Any) -> None:
        assert not self._has_events, "tracks are described before they are used"
        assert track.uuid, "0 is the trace's own track"
        assert track.uuid not in self.read.tracks
        assert track.name
        assert not track.parent_uuid or track.parent_uuid in self.read.tracks
        self.read.tracks[track.uuid] = track
        self.read.path(track.uuid)

    def _event(self, time: int, event: Any) -> None:
        self._has_events = True
        assert time >= self._time, "events are sorted"
        self._time = time
        track = self.read.tracks[event.track_uuid]
        assert (event.type == COUNTER) == track.HasField("counter"), (
            "counters have tracks of their own"
        )
        stack = self._stacks[event.track_uuid]
        if event.type == COUNTER:
            self.read.counters[self.read.path(track.uuid)].append((time, event.counter_value))
        elif event.type == END:
            assert stack, "what ends has begun"
            stack.pop().end = time
            assert not event.flow_ids
        else:
            assert event.type in (BEGIN, INSTANT)
            self._slice(time, event, stack)

    def _slice(self, time: int, event: Any, stack: list[Slice]) -> None:
        details = {
            self._names["debug_annotation_names"][one.name_iid]: value_of(one)
            for one in event.debug_annotations
        }
        name = self._names["event_names"][event.name_iid]
        category = self._names["event_categories"][event.category_iids[0]]
        end = time if event.type == INSTANT else None
        above = stack[-1] if stack else None
        new = Slice(
            self.read.path(event.track_uuid),
            name,
            category,
            time,
            end,
            above,
            details,
            event.track_uuid,
        )
        assert new.depth < DEEPEST_SLICE
        self.read.slices.append(new)
        if event.type == BEGIN:
            stack.append(new)
        assert len(set(event.flow_ids)) == len(event.flow_ids)
        for flow in event.flow_ids:
            stations = self.read.flows[flow]
            assert not stations or stations[-1].start <= time, "an arrow leads forward in time"
            stations.append(new)


def value_of(annotation: Any) -> Any:
    """Return the value of a debug annotation."""
    if annotation.dict_entries:
        return {entry.name: value_of(entry) for entry in annotation.dict_entries}
    if annotation.array_values:
        return [value_of(value) for value in annotation.array_values]
    kind = annotation.WhichOneof("value")
    return getattr(annotation, kind) if kind else None


def read_trace(trace_file: bytes, *, is_nonsense: bool = False) -> Read:
    """Read a trace, and check its rules. If *is_nonsense*, an arrow may lead nowhere."""
    trace = Trace()
    trace.ParseFromString(trace_file)
    reader = Reader()
    for packet in trace.packet:
        reader.packet(packet)
    check_siblings(reader.read)
    for stations in reader.read.flows.values():
        assert len(stations) > 1 or is_nonsense, f"an arrow from {stations[0]} to nowhere"
    return reader.read


def check_siblings(read: Read) -> None:
    """Check that siblings with the same name are of one kind, because Perfetto merges them."""
    alike: dict[tuple[int, str], tuple[Any, ...]] = {}
    for track in read.tracks.values():
        key = (track.parent_uuid, track.name)
        kind = (track.HasField("counter"), track.sibling_order_rank, track.child_ordering)
        assert alike.setdefault(key, kind) == kind, track.name
