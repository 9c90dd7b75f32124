"""A trace as a file that Perfetto opens: TrackEvent packets, in the order of time, with names
written once.

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
_STARTS_ANEW, _NEEDS_NAMES = 1, 2
_BY_RANK = 3
_LONGEST_TEXT = 2000
_MOST_PARTS = 50
"""Data with more text or more parts are shown as text, as it is in JSON, and cut."""
_LARGEST, _SMALLEST = (1 << 63) - 1, -(1 << 63)


def write_trace(run: Run, stream: BinaryIO) -> None:
    """Write a run as a Perfetto trace."""
    trace = Trace(run)
    add_task_tree(trace)
    add_modules(trace)
    if run.is_live and run.times:  # what has not ended lasts until the trace ends
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
    """Writes packets; remembers which names have been written."""

    def __init__(self, stream: BinaryIO) -> None:
        self._builder = StreamingTraceProtoBuilder(stream)
        self._names: dict[str, int] = {}
        self._categories: dict[str, int] = {}
        self._keys: dict[str, int] = {}
        self._flags = _STARTS_ANEW | _NEEDS_NAMES

    def clocks(self, began: int) -> None:
        """Say what time of the day it was when the trace's clock showed nothing."""
        packet = self._packet()
        for clock, time in ((_BOOTTIME, 0), (_REALTIME, began)):
            packet.clock_snapshot.clocks.add(clock_id=clock, timestamp=time)
        self._builder.write_packet(packet)

    def track(self, track: Track) -> None:
        """Describe a track."""
        packet = self._packet()
        described = packet.track_descriptor
        described.uuid, described.name = track.uuid, track.name or _NAMELESS
        if track.parent:
            described.parent_uuid, described.sibling_order_rank = track.parent, track.rank
        else:
            described.child_ordering = _BY_RANK
        if track.is_counter:
            described.counter.unit_name = "messages"
        self._builder.write_packet(packet)

    def event(self, event: Event) -> None:
        """Write an event."""
        packet = self._packet()
        packet.timestamp = event.time
        written = packet.track_event
        written.type, written.track_uuid = int(event.kind), event.track
        if event.kind is EventKind.COUNTER:
            written.counter_value = event.value
        if event.kind in _NAMED:
            known = packet.interned_data
            written.name_iid = _number(self._names, event.name or _NAMELESS, known.event_names)
            written.category_iids.append(
                _number(self._categories, event.category, known.event_categories)
            )
            written.flow_ids.extend(event.flows)
            for key, value in (event.details or {}).items():
                if value is not None:
                    told = written.debug_annotations.add()
                    told.name_iid = _number(self._keys, key, known.debug_annotation_names)
                    _put(told, _shortened(value))
        self._builder.write_packet(packet)

    def _packet(self) -> Any:
        packet = TracePacket(trusted_packet_sequence_id=_SEQUENCE, sequence_flags=self._flags)
        if self._flags & _STARTS_ANEW:
            packet.first_packet_on_sequence = True
        self._flags = _NEEDS_NAMES
        return packet


def _number(known: dict[str, int], name: str, written: Any) -> int:
    """The number that stands for a name, which is written with the first packet that needs it."""
    if name not in known:
        known[name] = len(known) + 1
        written.add(iid=known[name], name=name)
    return known[name]


def _shortened(value: Any) -> Any:
    """Plain data, as text if they are too long or have too many parts."""
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else ""
    return (
        text
        if len(text) > _LONGEST_TEXT or text.count("{") + text.count("[") > _MOST_PARTS
        else value
    )


def _put(annotation: Any, value: Any) -> None:
    """Write plain data, parts as parts."""
    if isinstance(value, dict):
        for key, item in value.items():
            _put(annotation.dict_entries.add(name=key), item)
    elif isinstance(value, list):
        for item in value:
            _put(annotation.array_values.add(), item)
    elif isinstance(value, bool):
        annotation.bool_value = value
    elif isinstance(value, int) and _SMALLEST <= value <= _LARGEST:
        annotation.int_value = value
    elif isinstance(value, float):
        annotation.double_value = value
    else:
        annotation.string_value = ("none" if value is None else str(value))[:_LONGEST_TEXT]
