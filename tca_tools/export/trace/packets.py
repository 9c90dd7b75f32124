"""A trace as a Perfetto file: TrackEvent packets in the order of time, with each name written once.

The packets follow perfetto.dev, "Writing TrackEvent Protos Synthetically".
"""

import json
from typing import Any, BinaryIO

from perfetto.protos.perfetto.trace.perfetto_trace_pb2 import TracePacket
from perfetto.trace_builder.proto_builder import StreamingTraceProtoBuilder

from tca_tools.export.nanoseconds import since_1970
from tca_tools.export.trace.events import Event, EventKind, Trace, Track
from tca_tools.export.trace.tracks import add_modules, add_task_tree
from tca_tools.journal.whole_run import Run

_SEQUENCE = 1
_NAMED = (EventKind.BEGIN, EventKind.INSTANT)
_NAMELESS = "?"
_REALTIME, _BOOTTIME = 1, 6
_RESETS_NAMES, _NEEDS_NAMES = 1, 2
_BY_RANK = 3
_LONGEST_TEXT = 2000
_MOST_PARTS = 50
"""Data with more text or more parts are written as JSON text, which is cut."""
_LARGEST, _SMALLEST = (1 << 63) - 1, -(1 << 63)


def write_trace(run: Run, stream: BinaryIO) -> None:
    """Write a run as a Perfetto trace."""
    trace = Trace(run)
    add_task_tree(trace)
    add_modules(trace)
    if run.is_live and run.times:  # this event sets the end of the trace, up to which spans extend
        track = trace.add("run", rank=1)
        now = max(trace.nanoseconds(run.time), trace.nanoseconds(run.times[-1]))
        track.events = iter(
            [track.instant(now, "still running", "run", {"last entry": run.times[-1]})]
        )
    writer = _Writer(stream)
    if run.began is not None:
        writer.clocks(since_1970(run))
    for track in trace.tracks:
        writer.track(track)
    for event in trace.events():
        writer.event(event)


class _Writer:
    """Writes packets, and remembers the names that are already in the file."""

    def __init__(self, stream: BinaryIO) -> None:
        self._builder = StreamingTraceProtoBuilder(stream)
        self._names: dict[str, int] = {}
        self._categories: dict[str, int] = {}
        self._keys: dict[str, int] = {}
        self._flags = _RESETS_NAMES | _NEEDS_NAMES

    def clocks(self, began: int) -> None:
        """Write the wall-clock time at which the trace's clock was zero."""
        packet = self._packet()
        for clock, time in ((_BOOTTIME, 0), (_REALTIME, began)):
            packet.clock_snapshot.clocks.add(clock_id=clock, timestamp=time)
        self._builder.write_packet(packet)

    def track(self, track: Track) -> None:
        """Write the description of a track."""
        packet = self._packet()
        descriptor = packet.track_descriptor
        descriptor.uuid, descriptor.name = track.uuid, track.name or _NAMELESS
        if track.parent:
            descriptor.parent_uuid, descriptor.sibling_order_rank = track.parent, track.rank
        else:
            descriptor.child_ordering = _BY_RANK
        if track.is_counter:
            descriptor.counter.unit_name = "messages"
        self._builder.write_packet(packet)

    def event(self, event: Event) -> None:
        """Write an event."""
        packet = self._packet()
        packet.timestamp = event.time
        packed = packet.track_event
        packed.type, packed.track_uuid = int(event.kind), event.track
        if event.kind is EventKind.COUNTER:
            packed.counter_value = event.value
        if event.kind in _NAMED:
            known = packet.interned_data
            packed.name_iid = _number(self._names, event.name or _NAMELESS, known.event_names)
            packed.category_iids.append(
                _number(self._categories, event.category, known.event_categories)
            )
            packed.flow_ids.extend(event.flows)
            for key, value in (event.details or {}).items():
                if value is not None:
                    annotation = packed.debug_annotations.add()
                    annotation.name_iid = _number(self._keys, key, known.debug_annotation_names)
                    _write_value(annotation, _shortened(value))
        self._builder.write_packet(packet)

    def _packet(self) -> Any:
        packet = TracePacket(trusted_packet_sequence_id=_SEQUENCE, sequence_flags=self._flags)
        if self._flags & _RESETS_NAMES:
            packet.first_packet_on_sequence = True
        self._flags = _NEEDS_NAMES
        return packet


def _number(known: dict[str, int], name: str, packed: Any) -> int:
    """Return the number of a name. The first packet that needs the name defines the number."""
    if name not in known:
        known[name] = len(known) + 1
        packed.add(iid=known[name], name=name)
    return known[name]


def _shortened(value: Any) -> Any:
    """Return plain data, as text if they are too long or have too many parts."""
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else ""
    is_large = len(text) > _LONGEST_TEXT or text.count("{") + text.count("[") > _MOST_PARTS
    return text if is_large else value


def _write_value(annotation: Any, value: Any) -> None:
    """Write plain data; dictionaries and lists keep their structure."""
    if isinstance(value, dict):
        for key, item in value.items():
            _write_value(annotation.dict_entries.add(name=key), item)
    elif isinstance(value, list):
        for item in value:
            _write_value(annotation.array_values.add(), item)
    elif isinstance(value, bool):
        annotation.bool_value = value
    elif isinstance(value, int) and _SMALLEST <= value <= _LARGEST:
        annotation.int_value = value
    elif isinstance(value, float):
        annotation.double_value = value
    else:
        annotation.string_value = ("none" if value is None else str(value))[:_LONGEST_TEXT]
