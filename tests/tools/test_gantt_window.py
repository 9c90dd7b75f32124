"""From when until when a Gantt chart goes by itself: as long as things happened, and no longer."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.story import COMMAND, THIS, Story, silent_for, walking

from tca_tools.gantt.build import chart
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.gantt.window import Pick
from tca_tools.run.fold import History
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass

Tca = Callable[..., Result]
NOW = 1000.0


def now_of(story: Story, *, is_live: bool = True) -> History:
    """The run, long after its last message."""
    history = story.fold()
    history.time, history.is_live = NOW, is_live
    return history


def moved() -> Story:
    """A single move, from second 10 to second 20."""
    story = Story().module("legs", "move").at(10.0)
    return story.acted(story.command("move", "user"), "legs", 10.0)


@pytest.mark.parametrize("is_live", [True, False])
def test_the_chart_of_a_run_in_which_all_has_ended_ends_with_that(is_live: bool) -> None:
    history = now_of(moved(), is_live=is_live)
    drawing = chart(history)
    assert (drawing.start, drawing.end) == pytest.approx((9.8, 20.2))
    assert "█ move ██" in "\n".join(chart_lines(drawing, 60))
    assert chart(history, 5.0, 900.0).end == 900.0


def test_the_default_of_the_command_and_of_a_report(tca: Tca, tmp_path: Path) -> None:
    folder = moved().write(tmp_path / "run")
    with silent_for(folder, 600.0):
        assert tca("gantt", folder).stdout.startswith("run: 9.80 to 20.20 s\n")
        assert tca("gantt", folder, "--to", 25).stdout.startswith("run: 9.80 to 25.00 s\n")
        tca("report", folder, "-o", tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    ticks = re.findall(r'class="faint tick[^>]*>(\d+) s<', page)
    assert (ticks[0], ticks[-1]) == ("10", "20")


def test_what_goes_on_reaches_until_now() -> None:
    moving, waiting, monitored = Story().module("legs", "move").at(10.0), moved(), moved()
    moving.delivered(moving.command("move", "user"), "legs")
    waiting.queued(waiting.command("fly", "user"))
    for story in (walking(), moving, waiting):
        assert chart(now_of(story)).end == NOW
    monitored.at(30.0).received("watch", MessageClass.POINT_MONITOR, "user")
    assert chart(now_of(monitored)).end == NOW  # nobody has begun to watch


def test_a_task_that_is_held_has_no_bar_but_goes_on() -> None:
    story = moved()
    arm = story.at(21.0).command("grip", "user")
    story.command("move", "user", 0, sequential_achievement(TaskId(arm), THIS))
    assert chart(now_of(story)).end == NOW
    assert chart(now_of(story), pick=Pick(messages=[1])).end == pytest.approx(20.2)
    assert chart(now_of(story, is_live=False)).end < 30.0


def test_a_lock_that_somebody_still_has_and_a_monitor_that_watches_are_just_there() -> None:
    story = moved().at(25.0).module("eyes").say(facts.Claimed(90, "legs", "legs", False, "eyes", TaskId(0)))
    story.say(facts.Granted(90))
    monitor = story.received("look", MessageClass.DEMON_MONITOR, "user")
    story.delivered(monitor, "legs").returned(monitor)
    still = now_of(story)
    assert 25.0 < chart(still).end < 26.0
    story.at(40.0).say(facts.ClaimEnded(90, "released"))
    assert 40.0 < chart(now_of(story)).end < 41.0


def granted_at_once() -> Story:
    """A program without handlers gets a lock without having to wait for it, and so does a handler."""
    story = Story().module("legs", "move").module("guest").at(1.0)
    move = story.received("move", COMMAND, "user")
    story.delivered(move, "legs").at(2.0)
    for number, sender, origin in ((90, "guest", 0), (91, "legs", move)):
        story.say(facts.Claimed(number, "arm", "arm", False, sender, TaskId(origin)), facts.Granted(number))
    return story.at(3.0).returned(move)


def test_a_wait_of_no_length_is_not_drawn() -> None:
    drawing = chart(granted_at_once().fold())
    assert [(row.label, len(row.handled)) for row in drawing.rows] == [("legs", 1)]
    assert drawing.rows[0].handled[0].waits == []
    assert "guest" not in "\n".join(chart_lines(drawing, 60))
    assert "guest waits" not in svg_text(drawing, "run")


def test_a_short_wait_looks_like_one() -> None:
    """However little room it has: what a program waits for is not handled."""
    story = Story().module("legs", "move").module("guest").at(1.0)
    story.say(facts.Claimed(90, "legs", "legs", False, "guest", TaskId(0))).at(1.001).say(facts.Granted(90))
    story.at(1.5).say(facts.ClaimEnded(90, "released")).at(2.0)
    story.acted(story.command("move", "user"), "legs", 20.0)
    drawing = chart(story.fold())
    lines = {line[:5].strip(): line for line in chart_lines(drawing, 60)}
    assert "▒" in lines["guest"]
    assert "█" not in lines["guest"]
    (look,) = re.findall(r"<rect ([^>]*)><title>guest waits for", svg_text(drawing, "run"))
    bar = re.search(r'<rect fill="(#\w+)"[^>]*><title>move', svg_text(drawing, "run"))
    assert bar
    assert bar[1] not in look
