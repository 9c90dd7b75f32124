"""What can be seen in a Gantt chart: failures, ends by a kill, queues, and colours that mean one thing."""

import colorsys
import re

import pytest
from tools.story import COMMAND, Story
from tools.test_coping import asking

from tca_tools.drawing.svg import width_of
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.build import NO_HANDLER, SUSPENDED, chart
from tca_tools.gantt.chart import Bar, Row
from tca_tools.gantt.looks import dark
from tca_tools.gantt.queues import curve, is_curve, queue_height
from tca_tools.gantt.svg import svg_text
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome


def shop(*failing: int, outcome: Outcome = Outcome.FAILED, steps: int = 1000) -> Story:
    """Many short steps one after the other, of which some end otherwise."""
    story = Story().module("legs", "step")
    for number in range(steps):
        command = story.at(float(number)).received("step", COMMAND, "x")
        how = outcome if number in failing else Outcome.DONE
        story.delivered(command, "legs").at(number + 0.5).returned(command, how)
    return story


def flags_of(story: Story) -> list[tuple[float, str]]:
    """Where they are, and what they tell."""
    picture = svg_text(chart(story.fold()), "shop")
    found = re.findall(r'class="flag" fill="(#\w+)" d="M([\d.]+) .*?<title>(.*?)</title>', picture)
    return [(float(left) + 4, title) for _, left, title in found]


def test_failures_in_narrow_bars_have_flags_above_their_row() -> None:
    [(first, told), (second, merged)] = flags_of(shop(100, 500, 501, 502))
    assert told.startswith("step {101} handled by legs from 100.000 s to 100.500 s")
    assert merged.startswith("3 failures from 500.500 s to 502.500 s, first: step {501}")
    assert second - first == pytest.approx((501.5 - 100.5) / 999.5 * 1700, abs=1)


def test_flags_are_in_the_legend_where_there_are_any() -> None:
    assert "here something failed" in svg_text(chart(shop(3).fold()), "shop")
    assert "here something failed" not in svg_text(chart(shop().fold()), "shop")


def test_flags_are_in_the_legend_in_their_colours() -> None:
    failed, handled = 'fill="url(#flag)"', 'fill="url(#amber-flag)"'
    coped = svg_text(chart(asking(dealt_with=True).fold()), "who asked goes on")
    assert (failed in coped, handled in coped) == (False, True)
    bad = svg_text(chart(shop(3).fold()), "shop")
    assert (failed in bad, handled in bad) == (True, False)


@pytest.mark.parametrize(("steps", "look"), [(3, 'class="killed"'), (1000, 'fill="#10161d"')])
def test_what_was_killed_has_a_dark_end(steps: int, look: str) -> None:
    """A narrow one, or a block of many, has a foot."""
    plain, drawn = (svg_text(chart(shop(*bad, outcome=Outcome.KILLED, steps=steps).fold()), "") for bad in ((), (2,)))
    assert drawn.count(look) > plain.count(look)
    assert ">killed</text>" in drawn
    assert ">killed</text>" not in plain


def test_no_name_has_the_grey_of_something_else() -> None:
    for number in range(60):
        red, green, blue = (int(dark(number)[place : place + 2], 16) / 255 for place in (1, 3, 5))
        assert colorsys.rgb_to_hls(red, green, blue)[2] > 0.25


def queue(*bars: tuple[float, float], is_nobodys: bool = False) -> Row:
    """A row of what waits, each bar in its lane, on a plot of 1000 pixels and seconds."""
    waiting = [Bar("step", start, end, str, lane=lane) for lane, (start, end) in enumerate(bars)]
    return Row("legs", queued=waiting, is_nobodys=is_nobodys)


SCALE = Scale(1000.0, 0.0, 1000.0)


def test_a_queue_is_hatched_where_that_can_be_seen_and_else_a_curve() -> None:
    assert not is_curve(queue((0, 40), (10, 50), (20, 25)), SCALE)
    assert is_curve(queue((0, 4), (10, 15), (20, 25)), SCALE)
    assert is_curve(queue(*[(0, 40)] * 7), SCALE)
    assert not is_curve(queue(*[(0, 40)] * 3, is_nobodys=True), SCALE)
    assert is_curve(queue(*[(0, 40)] * 4, is_nobodys=True), SCALE)  # they take little room


@pytest.mark.parametrize(
    ("bars", "left", "right"),
    [
        ([(200, 900)] * 7, 100, 200),  # left of the highest step
        ([(0, 100)] * 7, 100, 260),  # right of it
        ([(0, 100)] * 7 + [(0, 300)] * 7, 100, 460),  # behind what is high, too
        ([(0, 1000)] * 7, 0, 120),  # over it, in the row
        ([(0, 700)] * 6 + [(690, 1000)] * 7, 0, 700),  # over it, too
    ],
)
def test_the_number_of_a_curve_is_beside_its_highest_step_and_in_the_row(
    bars: list[tuple[float, float]], left: float, right: float
) -> None:
    *_, words = curve(queue(*bars), SCALE, 1.0, 0.0)
    found = re.search(r'class="number( before)?" x="([\d.]+)"', words)
    assert found
    begin = float(found[2]) - (width_of("up to 7 queued") if found[1] else 0)
    assert left <= begin <= right - width_of("up to 7 queued")


def test_where_never_more_than_one_waits_no_number_is_needed() -> None:
    row = queue((0, 4), is_nobodys=True)
    assert len(list(curve(row, SCALE, 1.0, 0.0))) == 1
    assert queue_height(row, is_curve=True) == queue_height(row, is_curve=False)


def test_a_legend_tells_of_curves_and_hatchings_that_there_are() -> None:
    story = Story().module("legs", "step").at(1.0)
    tasks = [TaskId(story.command("step", "user")) for _ in range(5)]
    story.say(*(facts.SuspendedOrResumed(task, True) for task in tasks)).at(9.0)
    picture = svg_text(chart(story.fold()), "still")
    assert ">how many are queued or suspended</text>" in picture
    assert "up to 5 suspended" in picture
    assert ">suspended</text>" not in picture


def test_rows_of_a_module_stand_together_and_what_is_no_modules_below() -> None:
    story = Story().module("oven", "heat").module("store", "fetch").at(1.0)
    for module, resource in [("oven", "chamber"), ("store", "phone"), ("oven", "meter")]:
        story.delivered(story.command("bake", "user"), module, resource)
    story.queued(story.command("fly", "user"))
    story.say(facts.SuspendedOrResumed(TaskId(story.command("mop", "user")), True)).at(2.0)
    rows = [row.label for row in chart(story.fold()).rows]
    used = ["oven / chamber", "oven / meter", "store / phone"]
    assert [label for label in rows if label in used] == used
    assert rows[-2:] == [SUSPENDED, NO_HANDLER]
