from collections.abc import Callable
from colorsys import rgb_to_hls
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result
from tools.story import QUERY, Story, stumbling, walking

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.build import NO_HANDLER, chart
from tca_tools.gantt.chart import Chart, lanes_of
from tca_tools.gantt.looks import dark, light
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_wire.journal import facts
from tca_wire.vocabulary import MessageClass

Tca = Callable[..., Result]
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return stumbling().write(tmp_path / "run")


def handled(drawing: Chart, label: str) -> list[tuple[str, float, float]]:
    row = next(row for row in drawing.rows if row.label == label)
    return [(bar.name, bar.start, bar.end) for bar in row.handled]


def test_the_chart_in_blocks(tca: Tca, run: Path, expect: Callable[[str, str], None]) -> None:
    expect("gantt_stumbling", tca("gantt", run, COLUMNS="100").stdout)
    expect("gantt_stumbling_ascii", tca("gantt", run, "--ascii", "--from", 0.5, "--to", 2.5, COLUMNS="72").stdout)


def test_lines_fit_the_terminal(tca: Tca, run: Path) -> None:
    for width in (20, 40, 133):
        lines = tca("gantt", run, COLUMNS=str(width)).stdout.splitlines()
        assert max(map(len, lines)) <= width


def test_bars_of_handlers_and_their_waits() -> None:
    drawing = chart(walking().fold())
    assert [row.label for row in drawing.rows] == ["user interface", "gait planner", "perception", "controller"]
    assert handled(drawing, "gait planner") == [
        ("traverse arc", 0.5, 0.7),
        ("take steps", 0.7, 1.4),
        ("take steps", 1.4, 2.2),
    ]
    planner, controller = drawing.rows[1], drawing.rows[3]
    assert [(wait.start, wait.end) for bar in planner.handled for wait in bar.waits] == [(0.8, 1.22), (1.5, 1.98)]
    assert planner.handled[1].title() == "take steps {2} handled by gait planner from 0.700 s to 1.400 s, 0.700 s"
    assert (
        planner.handled[1].waits[0].title()
        == "take steps {2} waits for elevation map {5} from 0.800 s to 1.220 s, 0.420 s"
    )
    assert [(bar.name, bar.is_open) for bar in controller.handled] == [("move leg", False), ("move body", True)]


def test_queued_messages_have_lanes_of_their_own() -> None:
    planner = chart(walking().fold()).rows[1]
    assert [(bar.start, bar.end, bar.lane) for bar in planner.queued] == [(0.6, 0.7, 0), (0.6, 1.4, 1)]
    assert (planner.lanes, lanes_of(planner.queued)) == (1, 2)
    assert planner.queued[0].title() == "take steps {2} queued for gait planner from 0.600 s to 0.700 s, 0.100 s"


def test_a_wait_outside_of_any_handler_is_a_bar_of_its_module() -> None:
    bar = chart(walking().fold()).rows[0].handled[0]
    assert (bar.name, bar.start, bar.end, bar.is_open) == ("traverse arc", 0.5, 4.0, True)
    assert [(wait.start, wait.end) for wait in bar.waits] == [(0.5, 4.0)]


def test_a_row_for_each_resource_and_for_what_nobody_handles() -> None:
    story = Story().module("arm", "reach", resource="arm")
    story.say(facts.ResourceChanged("arm", "gripper", 2))
    story.queued(story.goal("dance", "x"))
    assert [row.label for row in chart(story.fold()).rows] == ["arm", "arm / gripper", NO_HANDLER]


def test_a_module_that_handled_nothing_has_a_row_that_says_since_when_it_was_there(tca: Tca, tmp_path: Path) -> None:
    story = Story().module("legs", "move").module("user").at(5.0).module("lamp", "shine", resource="bulb")
    story.at(10.0).acted(story.command("move", "user"), "legs", 10.0)
    story.at(30.0).acted(story.command("move", "user"), "legs", 10.0)
    log = story.write(tmp_path / "run")
    lines = tca("gantt", log, "--from", 0, "--ascii", COLUMNS="52").stdout.splitlines()
    assert lines[3:6] == [
        "legs                   # move ##|         # move ##|",
        "lamp / bulb       __________________________________",
        "",
    ]
    assert lines[-1].endswith("__ connected")
    asked = tca("gantt", log, "--module", "user", "--ascii", COLUMNS="52").stdout.splitlines()
    assert asked[3] == "user  " + "_" * 46


def test_a_row_only_of_queues_has_no_room_for_bars() -> None:
    story = Story().module("legs", "walk")
    story.queued(story.goal("dance", "x")).at(1.0)
    legs, nobody = chart(story.fold()).rows
    assert (legs.lanes, lanes_of(legs.queued)) == (1, 0)
    assert (nobody.lanes, lanes_of(nobody.queued)) == (0, 1)


def test_a_chart_begins_and_ends_where_something_happens() -> None:
    story = Story().module("legs", "walk")
    story.at(50.0).delivered(story.goal("walk", "x"), "legs").at(60.0).returned(1).at(500.0)
    drawing = chart(story.fold())
    assert (drawing.start, drawing.end) == pytest.approx((49.8, 60.2))
    assert (chart(story.fold(), start=0.0).start, chart(story.fold(), end=500.0).end) == (0.0, 500.0)


def test_bars_that_overlap_in_one_resource_have_lanes() -> None:
    story = Story().module("map", "where")
    ids = [story.received("where", QUERY, "x") for _ in range(4)]
    for time, number in enumerate(ids):
        story.at(float(time)).delivered(number, "map")
        if time >= 2:
            story.returned(ids[time - 2])
    row = chart(story.at(9.0).fold()).rows[0]
    bars = [(round(bar.start), bar.end, bar.lane) for bar in row.handled]
    assert bars == [(0, 2, 0), (1, 3, 1), (2, 9, 0), (3, 9, 1)]


def test_a_part_of_the_time_keeps_the_colours() -> None:
    whole, part = chart(stumbling().fold()), chart(stumbling().fold(), 3.0, 4.0)
    assert part.names == whole.names == ["traverse arc", "take steps", "elevation map", "move leg", "move body"]
    assert [len(row.handled) for row in part.rows] == [1, 0, 0, 2]


def rectangles(picture: str) -> dict[str, tuple[float, float]]:
    """From where to where each titled rectangle goes."""
    found = {}
    for rectangle in ET.fromstring(picture).iter(f"{SVG}rect"):
        if (title := rectangle.find(f"{SVG}title")) is not None and title.text:
            left = float(rectangle.get("x", 0))
            found[title.text] = (left, left + float(rectangle.get("width", 0)))
    return found


def test_the_picture_has_a_rectangle_for_each_bar_and_wait() -> None:
    picture = svg_text(chart(stumbling().fold()), "stumbling <1>")
    found = rectangles(picture)
    leg = found["move leg {6} handled by controller from 1.400 s to 3.400 s, 2.000 s"]
    body = found["move body {7} handled by controller from 3.400 s to 4.500 s, 1.100 s: failed"]
    wait = found["take steps {2} waits for elevation map {5} from 0.800 s to 1.220 s, 0.420 s"]
    steps = found["take steps {2} handled by gait planner from 0.700 s to 1.400 s, 0.700 s"]
    assert leg[1] == pytest.approx(body[0], abs=1.0)
    assert (body[1] - body[0]) / (leg[1] - leg[0]) == pytest.approx(0.55, abs=0.01)
    assert steps[0] < wait[0] < wait[1] < steps[1]
    assert 'class="failed"' in picture
    assert "url(#queued1)" in picture


def test_names_stand_in_bars_that_have_room() -> None:
    picture = ET.fromstring(svg_text(chart(stumbling().fold()), "title"))
    texts = [text.text for text in picture.iter(f"{SVG}text")]
    assert texts.count("move leg") == 2  # in the legend and in its bar
    assert texts.count("traverse arc") == 1  # in the legend; its own bar is too narrow
    assert texts.count("waits for traverse arc") == 1
    assert "gait planner" in texts


def test_hostile_names_are_escaped() -> None:
    story = Story().module("<&>\x1b\x00", 'a "b"')
    goal = story.goal("</svg>\x07", "x")
    story.queued(goal, "<&>\x1b\x00").at(1.0).delivered(goal, "<&>\x1b\x00").at(2.0)
    picture = svg_text(chart(story.fold()), "]]> & <title>")
    assert "</svg>\\x07" in [text.text for text in ET.fromstring(picture).iter(f"{SVG}text")]


def test_an_empty_run() -> None:
    history = Story().fold()
    assert ET.fromstring(svg_text(chart(history), "empty")).tag == f"{SVG}svg"
    assert len(list(chart_lines(chart(history), 80))) == 4


def test_broadcasts_are_told_apart_by_receiver() -> None:
    story = Story().module("map", "pose").module("screen", "pose")
    pose = story.received("pose", MessageClass.BROADCAST, "legs")
    story.say(facts.Delivered(2, pose, "map", "map"), facts.Delivered(3, pose, "screen", "screen")).at(1.0)
    assert handled(chart(story.fold()), "screen") == [("pose", 0.0, 1.0)]


def test_a_span_that_is_none(tca: Tca, run: Path) -> None:
    result = tca("gantt", run, "--from", 3, "--to", 2)
    assert result.exit_code == 2
    assert "3 is not before the end, 2" in result.stderr


@pytest.mark.parametrize(
    ("start", "end", "labels"),
    [
        (0, 5, ["0 s", "1 s", "2 s", "3 s", "4 s", "5 s"]),
        (0.1, 0.52, ["0.1 s", "0.2 s", "0.3 s", "0.4 s", "0.5 s"]),
        (0, 0.0021, ["0.0000 s", "0.0005 s", "0.0010 s", "0.0015 s", "0.0020 s"]),
        (100, 250, ["2:00", "2:30", "3:00", "3:30", "4:00"]),
        (0, 4000, ["0:00", "15:00", "30:00", "45:00", "1:00:00"]),
        (0, 400_000, ["0:00", "24:00:00", "48:00:00", "72:00:00", "96:00:00"]),
        (2, 2, ["2 s"]),
    ],
)
def test_ticks_are_round(start: float, end: float, labels: list[str]) -> None:
    assert [label for _, label in ticks(start, end, 5)] == labels


def test_no_message_is_drawn_in_the_colour_of_failures() -> None:
    for number in range(200):
        red, green, blue = (int(dark(number)[place : place + 2], 16) for place in (1, 3, 5))
        hue, _, saturation = rgb_to_hls(red / 255, green / 255, blue / 255)
        assert saturation < 0.2 or 0.05 < hue < 0.93, dark(number)


def test_colours_are_dark_or_light() -> None:
    assert len({dark(number) for number in range(40)}) == 40
    for number in range(40):
        assert all(int(light(number)[place : place + 2], 16) > 150 for place in (1, 3, 5))
        assert sum(int(dark(number)[place : place + 2], 16) for place in (1, 3, 5)) < 420
