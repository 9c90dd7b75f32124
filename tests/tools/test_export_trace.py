"""A Perfetto trace, read back by the rules of Perfetto's trace processor."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tools.story import QUERY, Story, locking, stumbling, walking
from tools.telling import trace_of, track_lines

from tca_tools.export.trace.events import TraceSpan, in_lanes
from tca_wire.journal import facts
from tca_wire.vocabulary import MessageClass

SECOND = 1_000_000_000


def test_traces_match_their_transcript(tmp_path: Path, expect: Callable[[str, str], None]) -> None:
    traces = [trace_of(story.fold()) for story in (walking(), stumbling(), locking())]
    expect("trace", "\n".join(line for trace in traces for line in track_lines(trace)) + "\n")


def test_trace_lists_resources_in_order_of_appearance(tmp_path: Path) -> None:
    story = Story().module("oven", "heat").at(1.0)
    for resource in ("meter", "chamber"):
        story.delivered(story.command("bake", "user"), "oven", resource)
    tracks = [
        track for track in trace_of(story.at(2.0).fold()).tracks.values() if track.parent_uuid
    ]
    in_order = sorted(tracks, key=lambda track: track.sibling_order_rank)
    assert [track.name for track in in_order if track.name in ("meter", "chamber")] == [
        "meter",
        "chamber",
    ]


def test_overlapping_handlings_share_one_track_in_lanes(tmp_path: Path) -> None:
    story = Story().module("map", "where")
    ids = [story.received("where", QUERY, "x") for _ in range(4)]
    for time, number in enumerate(ids):
        story.at(float(time)).delivered(number, "map")
        if time >= 2:
            story.returned(ids[time - 2])
    read = trace_of(story.at(9.0).fold())
    lanes: dict[int, list[float]] = {}
    for one in read.on("map > map"):
        lanes.setdefault(one.lane, []).append(round(one.start / SECOND))
    assert list(lanes.values()) == [[0, 2], [1, 3]]


def test_trace_holds_a_thousand_simultaneous_waits(tmp_path: Path) -> None:
    """A handler gathers a thousand answers. The last answer to arrive is that to the first
    question.
    """
    story = Story().module("planner", "plan")
    plan = story.goal("plan", "user", to="planner")
    for number in range(1000):
        story.at(1.0 + number / 1000).received(
            "where", QUERY, "planner", origin=plan, blocking=True
        )
    for number in range(1000, 0, -1):
        story.at(3.0 - number / 1000).say(facts.Answered(1 + number))
    read = trace_of(story.fold())
    assert len([one for one in read.slices if one.category == "waiting"]) == 1000


def test_thousand_simultaneous_sends_become_one_instant(tmp_path: Path) -> None:
    """Perfetto stacks instants of one time, and refuses a stack of more than 512."""
    story = Story().module("a", "note").at(1.0)
    for _ in range(1000):
        story.received("note", MessageClass.INFORM, "central")
    read = trace_of(story.fold())
    assert [one.name for one in read.on("central > sent")] == ["sends 1000 messages"]


def test_large_data_is_cut_text_and_special_values_are_kept(tmp_path: Path) -> None:
    odd = {
        "many": list(range(500)),
        "big": 2**64 - 1,
        "none": None,
        "yes": True,
        "inf": float("inf"),
        3: b"\x00",
    }
    story = Story().module("map", "where").at(1.0)
    story.delivered(story.goal("where", "x", data=odd), "map")
    few = {key: value for key, value in odd.items() if key != "many"}
    story.at(2.0).delivered(story.goal("where", "x", data=few), "map")
    large, small = trace_of(story.fold()).on("map > map")
    assert large.details["data"].startswith('{"many": [0, 1, 2')
    assert len(large.details["data"]) == 2000
    assert small.details["data"] == {
        "big": str(2**64 - 1),
        "none": "none",
        "yes": True,
        "inf": "inf",
        "3": {"base64": "AA=="},
    }


def test_trace_has_a_wall_clock_snapshot(tmp_path: Path) -> None:
    assert trace_of(walking().fold()).clocks == {6: 0, 1: 1_700_000_000 * SECOND}


def test_in_lanes_separates_crossing_spans() -> None:
    crossing = [
        (TraceSpan(0, 5), "a"),
        (TraceSpan(1, 3), "b"),
        (TraceSpan(2, 4), "c"),
        (TraceSpan(5, None), "d"),
        (TraceSpan(6, 6), "e"),
    ]
    assert [[thing for _, thing in lane] for lane in in_lanes(crossing)] == [
        ["a", "d"],
        ["b", "e"],
        ["c"],
    ]


SHELL = os.environ.get("TRACE_PROCESSOR_SHELL") or shutil.which("trace_processor_shell")


@pytest.mark.slow
@pytest.mark.skipif(
    SHELL is None, reason="no trace_processor_shell (name one in $TRACE_PROCESSOR_SHELL)"
)
def test_trace_processor_finds_no_error(tmp_path: Path) -> None:
    from perfetto.trace_processor import TraceProcessor, TraceProcessorConfig

    path = tmp_path / "run.pftrace"
    read = trace_of(stumbling().fold())
    with TraceProcessor(trace=str(path), config=TraceProcessorConfig(bin_path=SHELL)) as processor:
        errors = processor.query(
            "select name, value from stats where severity != 'info' and value > 0"
        )
        assert [(row.name, row.value) for row in errors] == []
        assert next(iter(processor.query("select count(*) as n from slice"))).n == len(read.slices)
        assert next(iter(processor.query("select count(*) as n from flow"))).n == len(read.arrows())


def test_tasks_below_the_deepest_track_share_it(tmp_path: Path) -> None:
    story, parent = Story().at(1.0), 0
    for _ in range(2000):
        parent = story.goal("step", "x", parent)
    read = trace_of(story.fold())
    names = {track.name for track in read.tracks.values()}
    assert "depth 12 and deeper" in names
    assert "depth 13" not in names
    assert len([one for one in read.slices if one.category == "task"]) == 2000
