"""A Perfetto trace: its tracks, slices, arrows and counters, read back by the rules of Perfetto's trace processor."""

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

import pytest
from tools.story import GOAL, QUERY, Story, stumbling, walking
from tools.trace_reader import Read, Slice, read_trace

from tca_tools.export.trace.lanes import Span, in_lanes, nested
from tca_tools.export.trace.packets import write_trace
from tca_tools.run.fold import History
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome

SECOND = 1_000_000_000


def trace_of(history: History, folder: Path) -> Read:
    path = folder / "run.pftrace"
    with path.open("wb") as stream:
        write_trace(history, stream)
    return read_trace(path)


def spans(slices: Iterable[Slice], category: str) -> list[tuple[str, float, float | None]]:
    return [
        (one.name, one.start / SECOND, None if one.end is None else one.end / SECOND)
        for one in slices
        if one.category == category
    ]


def test_a_resource_is_a_track_with_its_handlings_and_their_waits(tmp_path: Path) -> None:
    read = trace_of(walking().fold(), tmp_path)
    planner = read.on("gait planner > gait planner")
    assert spans(planner, "handling") == [
        ("traverse arc", 0.5, 0.7),
        ("take steps", 0.7, 1.4),
        ("take steps", 1.4, 2.2),
    ]
    waits = [one for one in planner if one.category == "waiting"]
    assert spans(waits, "waiting") == [("waits for elevation map", 0.8, 1.22), ("waits for elevation map", 1.5, 1.98)]
    assert [(one.parent.name, one.parent.start) for one in waits if one.parent] == [
        ("take steps", 0.7 * SECOND),
        ("take steps", 1.4 * SECOND),
    ]
    assert spans(read.on("controller > controller"), "handling") == [("move leg", 1.4, 3.4), ("move body", 3.4, None)]
    assert spans(read.on("user interface > outside of handlers"), "waiting") == [("waits for traverse arc", 0.5, None)]
    assert spans(read.on("controller"), "module") == [("connected", 0.2, None)]


def test_resources_stand_in_the_order_in_which_they_came_as_in_charts(tmp_path: Path) -> None:
    story = Story().module("oven", "heat").at(1.0)
    for resource in ("meter", "chamber"):
        story.delivered(story.command("bake", "user"), "oven", resource)
    tracks = [track for track in trace_of(story.at(2.0).fold(), tmp_path).tracks.values() if track.parent_uuid]
    in_order = sorted(tracks, key=lambda track: track.sibling_order_rank)
    assert [track.name for track in in_order if track.name in ("meter", "chamber")] == ["meter", "chamber"]


def test_a_message_is_an_arrow_from_its_sender_through_the_queue_to_its_handler(tmp_path: Path) -> None:
    read = trace_of(walking().fold(), tmp_path)
    stations = [(one.track, one.category, one.name) for one in read.flows[2]]
    assert stations == [
        ("gait planner > gait planner", "sent", "sends 3 messages"),
        ("gait planner > queue of gait planner", "queued", "take steps"),
        ("gait planner > gait planner", "handling", "take steps"),
    ]
    assert [(one.track, one.name) for one in read.flows[6]] == [
        ("gait planner > gait planner", "sends 2 messages"),
        ("controller > controller", "move leg"),
    ]
    sent = read.flows[6][0].parent
    assert sent is not None
    assert (sent.name, sent.details["id"]) == ("take steps", 2)
    assert 4 not in read.flows  # held, so it arrived nowhere


def test_a_query_leads_to_who_answers(tmp_path: Path) -> None:
    read = trace_of(walking().fold(), tmp_path)
    asked, answering = read.flows[5]
    assert (asked.name, answering.track) == ("sends elevation map", "perception > perception")
    assert answering.details["result"] == {"ok": 1}


def test_the_details_of_a_handling(tmp_path: Path) -> None:
    read = trace_of(walking().fold(), tmp_path)
    leg = read.on("controller > controller")[0]
    assert leg.details == {
        "id": 6,
        "class": "command",
        "sender": "gait planner",
        "parent": "take steps {2}",
        "data": {"leg": 2, "height": 0.3},
        "outcome": "done",
        "result": {"contact": [1.0, 2.0, -0.25]},
    }


def test_queue_lengths_are_counters(tmp_path: Path) -> None:
    read = trace_of(walking().fold(), tmp_path)
    length = read.counters["gait planner > queue length of gait planner"]
    assert [(time / SECOND, number) for time, number in length] == [(0.6, 2), (0.7, 1), (1.4, 0)]


def test_the_task_tree_has_a_track_for_each_depth(tmp_path: Path) -> None:
    read = trace_of(walking().fold(), tmp_path)
    assert spans(read.on("task tree > depth 1"), "task") == [("traverse arc", 0.5, None)]
    assert spans(read.on("task tree > depth 2"), "task") == [("take steps", 0.6, None)] * 3
    second = next(one for one in read.on("task tree > depth 2") if one.details.get("id") == 3)
    states = [one for one in read.slices if one.parent is second]
    assert spans(states, "state") == [("queued", 0.6, 1.4), ("planning", 1.4, 2.2), ("planned", 2.2, None)]
    assert spans(read.on("task tree > depth 3"), "task")[0] == ("move leg", 1.4, 3.4)


def test_failures_and_kills_are_instants(tmp_path: Path) -> None:
    read = trace_of(stumbling().fold(), tmp_path)
    failed = [one for one in read.slices if one.name == "failed"]
    assert {(one.track, one.start / SECOND, one.end == one.start) for one in failed} == {
        ("controller > controller", 4.5, True),
        ("task tree > depth 3", 4.5, True),
    }
    assert {one.details["failure"] for one in failed} == {"terrain collision: leg 4 met\x1b[31m rock"}
    assert all(one.parent for one in failed)
    assert [one.details["handled"] for one in failed] == [False, False]
    killed = [one for one in read.slices if one.name == "killed"]
    assert len(killed) == 6
    assert {one.details["why"] for one in killed} == {"failure 'terrain collision' of move body {7} was not handled"}


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
    plan = story.goal("plan", "user")
    story.delivered(plan, "planner").at(1.0)
    where = story.received("where", QUERY, "planner", origin=plan, blocking=True)
    story.at(2.0)
    what = story.received("what", QUERY, "planner", origin=plan, blocking=True)
    story.at(3.0).say(facts.Answered(where)).at(4.0).say(facts.Answered(what)).at(5.0).returned(plan)
    read = trace_of(story.fold(), tmp_path)
    assert spans(read.on("planner > planner"), "waiting") == [("waits for where", 1.0, 3.0)]
    assert spans(read.on("planner > further waits of planner"), "waiting") == [("waits for what", 2.0, 4.0)]


def test_a_thousand_waits_at_a_time(tmp_path: Path) -> None:
    """A handler that gathers a thousand answers, the first asked being the last to come."""
    story = Story().module("planner", "plan")
    plan = story.goal("plan", "user")
    story.delivered(plan, "planner")
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
    story.at(1.0)
    two = story.received("two", QUERY, "a", origin=one)
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


def test_a_deep_tree_shares_its_last_track(tmp_path: Path) -> None:
    story, parent = Story().at(1.0), 0
    for _ in range(2000):
        parent = story.goal("step", "x", parent)
    read = trace_of(story.fold(), tmp_path)
    names = {track.name for track in read.tracks.values()}
    assert "depth 12 and deeper" in names
    assert "depth 13" not in names
    assert len([one for one in read.slices if one.category == "task"]) == 2000


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


def test_locks_have_a_track(tmp_path: Path) -> None:
    story = Story().module("arm", "reach").at(1.0).say(facts.Claimed(7, "arm", "arm", False, "user", 0))
    story.at(2.0).say(facts.Granted(7)).at(3.0).say(facts.ClaimEnded(7, "released"))
    read = trace_of(story.fold(), tmp_path)
    assert spans(read.on("arm > locks of arm"), "lock") == [("locked by user", 2.0, 3.0)]
    assert spans(read.on("user > outside of handlers"), "waiting") == [("waits for a lock", 1.0, 2.0)]


def test_direct_messages_have_slices_without_arrows(tmp_path: Path) -> None:
    story = Story().module("map", "where").at(5.0)
    story.say(facts.HandledDirectly("where", "map", "map", "user", 0, 8, 4.5, 0.25, Outcome.DONE, ""))
    read = trace_of(story.fold(), tmp_path)
    (handled,) = read.on("map > map")
    assert (handled.start, handled.end) == (4.25 * SECOND, 4.5 * SECOND)
    assert handled.details["directly from"] == "user"
    assert not read.flows


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
    walk = story.goal("walk", "x")
    story.delivered(walk, "legs").at(2.0).returned(walk, Outcome.FAILED).say(facts.Failed(walk, "slip", ""))
    story.at(3.0).reached(walk, Moment.END_ACHIEVING).at(4.0).say(facts.Recovered(TaskId(walk)))
    read = trace_of(story.fold(), tmp_path)
    assert spans(read.slices, "state") == [("planning", 1.0, 2.0), ("failed", 2.0, 3.0)]


def test_lanes_and_nesting() -> None:
    crossing = [(Span(0, 5), "a"), (Span(1, 3), "b"), (Span(2, 4), "c"), (Span(5, None), "d"), (Span(6, 6), "e")]
    assert [[thing for _, thing in lane] for lane in in_lanes(crossing)] == [["a", "d"], ["b", "e"], ["c"]]
    fitting, others = nested(crossing)
    assert ([thing for _, thing in fitting], [thing for _, thing in others]) == (["a", "b", "d", "e"], ["c"])


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
