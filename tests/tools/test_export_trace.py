"""A Perfetto trace: its tracks, slices, arrows and counters, read back by the rules of Perfetto's trace processor."""

import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import pytest
from tools.story import GOAL, QUERY, Story, locking, stumbling, walking
from tools.trace_reader import Read, Slice, read_trace

from tca_tools.export.trace.events import TraceSpan, in_lanes
from tca_tools.export.trace.packets import write_trace
from tca_tools.journal.fold import History
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass

SECOND = 1_000_000_000


def trace_of(history: History, folder: Path) -> Read:
    path = folder / "run.pftrace"
    with path.open("wb") as stream:
        write_trace(history, stream)
    return read_trace(path)


def told(read: Read) -> Iterator[str]:
    """All that is in a trace: tracks with their slices, arrows, counters."""
    for track, slices in groupby(
        sorted(read.slices, key=attrgetter("track", "lane", "start")), key=attrgetter("track")
    ):
        yield track
        for one in slices:
            until = "" if one.end == one.start else " on" if one.end is None else f" to {one.end / SECOND:.3f}"
            details = ", ".join(f"{key}: {value}" for key, value in one.details.items())
            yield f"{'  ' * (one.depth + 1)}{one.start / SECOND:.3f}{until} {one.category}: {one.name}; {details}"
    for number, stations in sorted(read.flows.items()):
        yield f"arrow {number}: {' -> '.join(f'{one.name} ({one.track})' for one in stations)}"
    for counter, values in read.counters.items():
        yield f"{counter}: {', '.join(f'{number} at {time / SECOND}' for time, number in values)}"


def test_all_of_a_trace(tmp_path: Path, expect: Callable[[str, str], None]) -> None:
    traces = [trace_of(story.fold(), tmp_path) for story in (walking(), stumbling(), locking())]
    expect("trace", "\n".join(line for trace in traces for line in told(trace)) + "\n")


def spans(slices: Iterable[Slice], category: str) -> list[tuple[str, float, float | None]]:
    return [
        (one.name, one.start / SECOND, None if one.end is None else one.end / SECOND)
        for one in slices
        if one.category == category
    ]


def test_resources_stand_in_the_order_in_which_they_came_as_in_charts(tmp_path: Path) -> None:
    story = Story().module("oven", "heat").at(1.0)
    for resource in ("meter", "chamber"):
        story.delivered(story.command("bake", "user"), "oven", resource)
    tracks = [track for track in trace_of(story.at(2.0).fold(), tmp_path).tracks.values() if track.parent_uuid]
    in_order = sorted(tracks, key=lambda track: track.sibling_order_rank)
    assert [track.name for track in in_order if track.name in ("meter", "chamber")] == ["meter", "chamber"]


def test_handlings_that_overlap_have_lanes_that_are_shown_as_one_track(tmp_path: Path) -> None:
    story = Story().module("map", "where")
    ids = [story.received("where", QUERY, "x") for _ in range(4)]
    for time, number in enumerate(ids):
        story.at(float(time)).delivered(number, "map")
        if time >= 2:
            story.returned(ids[time - 2])
    read = trace_of(story.at(9.0).fold(), tmp_path)
    lanes: dict[int, list[float]] = {}
    for one in read.on("map > map"):
        lanes.setdefault(one.lane, []).append(round(one.start / SECOND))
    assert list(lanes.values()) == [[0, 2], [1, 3]]


def test_waits_that_overlap_leave_their_handler(tmp_path: Path) -> None:
    """An asynchronous handler asks two things at once; neither wait lies within the other."""
    story = Story().module("planner", "plan").module("map", "where", "what")
    plan = story.goal("plan", "user", to="planner")
    where = story.at(1.0).received("where", QUERY, "planner", origin=plan, blocking=True)
    what = story.at(2.0).received("what", QUERY, "planner", origin=plan, blocking=True)
    story.at(3.0).say(facts.Answered(where)).at(4.0).say(facts.Answered(what)).at(5.0).returned(plan)
    read = trace_of(story.fold(), tmp_path)
    assert spans(read.on("planner > planner"), "waiting") == [("waits for where", 1.0, 3.0)]
    assert spans(read.on("planner > further waits of planner"), "waiting") == [("waits for what", 2.0, 4.0)]


def test_a_thousand_waits_at_a_time(tmp_path: Path) -> None:
    """A handler that gathers a thousand answers, the first asked being the last to come."""
    story = Story().module("planner", "plan")
    plan = story.goal("plan", "user", to="planner")
    for number in range(1000):
        story.at(1.0 + number / 1000).received("where", QUERY, "planner", origin=plan, blocking=True)
    for number in range(1000, 0, -1):
        story.at(3.0 - number / 1000).say(facts.Answered(1 + number))
    read = trace_of(story.fold(), tmp_path)
    assert len([one for one in read.slices if one.category == "waiting"]) == 1000


def test_a_broadcast_is_an_arrow_to_each_receiver(tmp_path: Path) -> None:
    story = Story().module("legs", "pose").module("map", "pose").at(1.0)
    pose = story.received("pose", MessageClass.BROADCAST, "legs")
    story.say(facts.Delivered(20, pose, "legs", "legs"), facts.Delivered(21, pose, "map", "map"))
    read = trace_of(story.fold(), tmp_path)
    assert {(start.name, end.track) for start, end in read.arrows()} == {
        ("sends pose", "legs > legs"),
        ("sends pose", "map > map"),
    }


def test_what_happens_at_one_time_keeps_its_order(tmp_path: Path) -> None:
    """A coarse clock: sent, handled and sent on, all within one tick; arrows lead forward all the same."""
    story = Story().module("a", "one").module("b", "two").at(1.0)
    one = story.received("one", GOAL, "user")
    story.at(1.0).delivered(one, "a")
    two = story.at(1.0).received("two", QUERY, "a", origin=one)
    story.at(1.0).delivered(two, "b").at(1.0).returned(two)
    read = trace_of(story.fold(), tmp_path)
    assert [(start.name, end.name) for start, end in read.arrows()] == [("sends one", "one"), ("sends two", "two")]
    assert read.flows[two][0].parent is read.flows[one][1]


def test_a_thousand_messages_of_one_moment_are_one_event(tmp_path: Path) -> None:
    """Perfetto stacks instants of one time, and refuses a stack of more than 512."""
    story = Story().module("a", "note").at(1.0)
    for _ in range(1000):
        story.received("note", MessageClass.INFORM, "central")
    read = trace_of(story.fold(), tmp_path)
    assert [one.name for one in read.on("central > sent")] == ["sends 1000 messages"]


def test_a_resource_that_is_named_like_another_track(tmp_path: Path) -> None:
    story = Story().module("arm", "reach").at(1.0)
    story.say(facts.ResourceChanged("arm", "", 1), facts.ResourceChanged("arm", "queue of arm", 1))
    one, two, three = (story.goal("reach", "x") for _ in range(3))
    story.delivered(one, "arm", "arm").delivered(two, "arm", "queue of arm").queued(three, "arm", "arm")
    story.say(facts.Delivered(9, 9, "arm", ""))
    read = trace_of(story.fold(), tmp_path)
    assert {one.track for one in read.slices if one.category in ("handling", "queued")} == {
        "arm > arm",
        "arm > arm (another)",
        "arm > queue of arm",
        "arm > queue of arm (another)",
    }


def test_large_data_is_text_and_odd_data_are_told(tmp_path: Path) -> None:
    odd = {"many": list(range(500)), "big": 2**64 - 1, "none": None, "yes": True, "inf": float("inf"), 3: b"\x00"}
    story = Story().module("map", "where").at(1.0)
    story.delivered(story.goal("where", "x", data=odd), "map")
    few = {key: value for key, value in odd.items() if key != "many"}
    story.at(2.0).delivered(story.goal("where", "x", data=few), "map")
    large, small = trace_of(story.fold(), tmp_path).on("map > map")
    assert large.details["data"].startswith('{"many": [0, 1, 2')
    assert len(large.details["data"]) == 2000
    assert small.details["data"] == {
        "big": str(2**64 - 1),
        "none": "none",
        "yes": True,
        "inf": "inf",
        "3": {"base64": "AA=="},
    }


def test_the_wall_clock_is_told(tmp_path: Path) -> None:
    assert trace_of(walking().fold(), tmp_path).clocks == {6: 0, 1: 1_700_000_000 * SECOND}


def test_a_task_that_goes_on_after_its_failure(tmp_path: Path) -> None:
    """A failure that is dealt with after the task's end does not make its last state longer than itself."""
    story = Story().module("legs", "walk").at(1.0)
    walk = story.goal("walk", "x", to="legs")
    story.at(2.0).failed(walk, "slip", "")
    story.at(3.0).reached(walk, Moment.END_ACHIEVING).at(4.0).say(facts.Recovered(TaskId(walk)))
    read = trace_of(story.fold(), tmp_path)
    assert spans(read.slices, "state") == [("planning", 1.0, 2.0), ("failed", 2.0, 3.0)]


def test_lanes() -> None:
    crossing = [
        (TraceSpan(0, 5), "a"),
        (TraceSpan(1, 3), "b"),
        (TraceSpan(2, 4), "c"),
        (TraceSpan(5, None), "d"),
        (TraceSpan(6, 6), "e"),
    ]
    assert [[thing for _, thing in lane] for lane in in_lanes(crossing)] == [["a", "d"], ["b", "e"], ["c"]]


SHELL = os.environ.get("TRACE_PROCESSOR_SHELL") or shutil.which("trace_processor_shell")


@pytest.mark.slow
@pytest.mark.skipif(SHELL is None, reason="no trace_processor_shell (name one in $TRACE_PROCESSOR_SHELL)")
def test_perfettos_own_trace_processor_finds_no_error(tmp_path: Path) -> None:
    from perfetto.trace_processor import TraceProcessor, TraceProcessorConfig

    path = tmp_path / "run.pftrace"
    read = trace_of(stumbling().fold(), tmp_path)
    with TraceProcessor(trace=str(path), config=TraceProcessorConfig(bin_path=SHELL)) as processor:
        errors = processor.query("select name, value from stats where severity != 'info' and value > 0")
        assert [(row.name, row.value) for row in errors] == []
        assert next(iter(processor.query("select count(*) as n from slice"))).n == len(read.slices)
        assert next(iter(processor.query("select count(*) as n from flow"))).n == len(read.arrows())


def test_a_deep_tree_shares_its_last_track(tmp_path: Path) -> None:
    story, parent = Story().at(1.0), 0
    for _ in range(2000):
        parent = story.goal("step", "x", parent)
    read = trace_of(story.fold(), tmp_path)
    names = {track.name for track in read.tracks.values()}
    assert "depth 12 and deeper" in names
    assert "depth 13" not in names
    assert len([one for one in read.slices if one.category == "task"]) == 2000
