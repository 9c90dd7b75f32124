"""The chart of a task's story shows when that, or what is under it, was held, and what it waited for then."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result
from tools.made_robots import stepping
from tools.story import COMMAND, THIS, Story, walking

from tca_tools.gantt.build import NO_HANDLER, chart
from tca_tools.gantt.chart import Chart
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.gantt.window import Pick
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.vocabulary import Condition

Tca = Callable[..., Result]
SVG = "{http://www.w3.org/2000/svg}"


def held(drawing: Chart) -> dict[str, list[tuple[float, float]]]:
    """What stands on the bars of what is held, and from when until when they go."""
    found: dict[str, list[tuple[float, float]]] = {}
    for row in drawing.rows:
        for bar in row.held:
            found.setdefault(f"{row.label}: {bar.words(200)}", []).append((bar.start, bar.end))
    return found


def test_it_shows_until_what_a_task_is_held(tca: Tca, tmp_path: Path, expect: Callable[[str, str], None]) -> None:
    folder = walking().write(tmp_path / "walk")
    expect("gantt_held_story", tca("gantt", folder, "--story", 1, COLUMNS="100").stdout)
    expect("gantt_held_story_ascii", tca("gantt", folder, "--story", 4, "--ascii", COLUMNS="100").stdout)


def test_a_task_that_was_planned_is_held_until_it_may_be_achieved() -> None:
    drawing = chart(walking().fold(), pick=Pick(messages={3}, held={3}))
    assert held(drawing) == {"gait planner: take steps {3}: until take steps {2} is achieved": [(2.2, 4.0)]}
    (bar,) = next(row for row in drawing.rows if row.held).held
    assert bar.is_open
    assert bar.title() == "take steps {3} held until take steps {2} is achieved from 2.200 s on, 1.800 s"


def test_a_wiretap_is_named() -> None:
    tale = Story().module("arm", "move").module("checker", "check").at(1.0)
    tale.say(facts.TapAdded(90, Condition.BEFORE_HANDLING, "check", "move", ROOT, "safety"))
    move = tale.command("move", "user")
    check = tale.received("check", COMMAND, "central", parent=move)
    tale.say(facts.TapFired(90, move, check)).delivered(check, "checker").at(3.0)
    assert held(chart(tale.fold(), pick=Pick(held={move}))) == {
        "arm: move {1}: until check {2}, the listener of a wiretap of safety, has been handled": [(1.0, 3.0)]
    }


def waiting_for_two() -> Chart:
    """A move {3} waits for a move {1} until 3 s and for a look {2} until 4 s; and so does another one {4}."""
    tale = Story().module("legs", "move", "look").at(1.0)
    first, second = tale.command("move", "user"), tale.command("look", "user")
    both = [sequential_achievement(TaskId(one), THIS) for one in (first, second)]
    held_back = [tale.command("move", "user", 0, *both) for _ in range(2)]
    tale.delivered(first, "legs").delivered(second, "legs")
    tale.at(3.0).returned(first).reached(first, Moment.END_ACHIEVING)
    tale.at(4.0).returned(second).reached(second, Moment.END_ACHIEVING)
    for one in held_back:
        tale.delivered(one, "legs")
    return chart(tale.fold(), pick=Pick(held=held_back))


def test_each_cause_has_a_bar_of_its_own_in_the_lane_of_the_task() -> None:
    (row,) = (row for row in waiting_for_two().rows if row.held)
    assert sorted((bar.lane, bar.start, bar.end, bar.words(200)) for bar in row.held) == [
        (0, 1.0, 3.0, "move {3}: until move {1}, look {2} are achieved"),
        (0, 3.0, 4.0, "until look {2} is achieved"),
        (1, 1.0, 3.0, "move {4}: until move {1}, look {2} are achieved"),
        (1, 3.0, 4.0, "until look {2} is achieved"),
    ]
    last = max(row.held, key=lambda bar: (bar.lane, bar.start))
    assert last.title() == "move {4} held until look {2} is achieved from 3.000 s to 4.000 s, 1.000 s"


def test_the_text_shows_where_the_cause_changes() -> None:
    lines = [line for line in chart_lines(waiting_for_two(), 120) if "until" in line]
    assert [line.count("╎ until look {2} is achieved ·") for line in lines] == [1, 1]


def test_what_nobody_would_handle_stands_where_that_is_said() -> None:
    tale = Story().module("legs", "move").at(1.0)
    move = tale.command("move", "user")
    tale.delivered(move, "legs")
    fly = tale.command("fly", "user", 0, sequential_achievement(TaskId(move), THIS))
    drawing = chart(tale.at(5.0).fold(), pick=Pick(held={fly}))
    assert list(held(drawing)) == [f"{NO_HANDLER}: fly {{2}}: until move {{1}} is achieved"]


def test_only_a_story_shows_it(tca: Tca, tmp_path: Path) -> None:
    folder = walking().write(tmp_path / "walk")
    assert "held" not in tca("gantt", folder).stdout
    assert "held" not in tca("gantt", folder, "--task", 1).stdout


@pytest.mark.parametrize("steps", [4, 300])
def test_the_picture_says_it_and_does_not_grow_without_end(steps: int) -> None:
    picture = svg_text(chart(stepping(steps=steps).fold(), pick=Pick(held=range(1, 2 + steps))), "held")
    drawn = ET.fromstring(picture)
    shapes = [one for one in drawn.iter(f"{SVG}rect") if one.get("stroke-dasharray") == "4 3"]
    said = [one.text or "" for one in drawn.iter(f"{SVG}text")]
    assert len(shapes) <= 1 + 6  # with the legend's
    assert ("more are held" in picture) == (steps > 7)
    assert ("step {4}: until step {3} is achieved" in said) == (steps < 7)  # narrow bars say less
