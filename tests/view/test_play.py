"""Playing a run. Time moves smoothly, even through silences, and never backwards."""

import itertools
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from tools.story import Story

from view.conftest import OpenPage

pytestmark = pytest.mark.slow


@pytest.fixture
def quiet(tmp_path: Path) -> Path:
    """Return two short moves with an hour between them."""
    story = Story().module("legs", "move").at(1.0)
    story.acted(story.command("move", "user"), "legs", 10.0).at(3600.0)
    return story.acted(story.command("move", "user"), "legs", 1.0).write(tmp_path / "quiet")


def times(page: Page, number: int, milliseconds: int) -> list[float]:
    """Return the times on slider and chart, sampled *number* times, *milliseconds* apart."""
    found = []
    for _ in range(number):
        page.clock.run_for(milliseconds)
        time, charted = page.evaluate("[tca.slider.time, tca.chart.time]")
        assert time == pytest.approx(charted, abs=0.1)
        found.append(time)
    return found


def test_play_button_plays_a_run(open_page: OpenPage, quiet: Path) -> None:
    """One page serves for three parts, because a page with a clock of its own opens slowly."""
    page = open_page(quiet, clock=True)
    for time, plays in (
        (6, assert_plays_between_messages),
        (20, assert_plays_silence_fast),
        (3.5, assert_zoomed_chart_follows),
    ):
        page.evaluate(f"location.hash = '#t={time}'")
        page.clock.run_for(500)
        plays(page)


def assert_plays_between_messages(page: Page) -> None:
    assert page.evaluate("tca.slider.time") == 6
    page.locator("#play").click()
    shown = [
        6.0,
        *times(page, 10, 100),
    ]  # within an action, played in half its time
    steps = [later - earlier for earlier, later in itertools.pairwise(shown)]
    assert min(steps) > 0
    time, now = page.evaluate("[tca.slider.playing.time, tca.slider.playing.last]")
    page.clock.run_for(100)
    later, then = page.evaluate("[tca.slider.playing.time, tca.slider.playing.last]")
    assert later - time == pytest.approx((then - now) / 1000 * 2)  # 10 s of silence take 5 s
    expect(page.locator("#play")).to_have_text("❚❚")
    page.keyboard.press("Space")
    page.clock.run_for(500)
    stopped = page.evaluate("tca.slider.time")
    assert stopped >= shown[-1]
    assert page.evaluate("tca.tree.time") == stopped
    page.clock.run_for(1000)
    assert page.evaluate("tca.slider.time") == stopped


def assert_plays_silence_fast(page: Page) -> None:
    """Assert that a long silence is played fast, and that the clock is marked meanwhile."""
    page.locator("#play").click()
    shown = times(page, 3, 500)
    assert shown == sorted(set(shown))
    assert 20 < shown[0] < 3600
    expect(page.locator("#clock")).to_have_class("faster")
    page.clock.run_for(5000)
    assert page.evaluate("tca.slider.time") > 3600
    expect(page.locator("#clock")).not_to_have_class("faster")
    page.clock.run_for(3000)
    expect(page.locator("#play")).to_have_text("▶")
    expect(page.locator("#clock")).to_have_text("1:00:01.0")


def assert_zoomed_chart_follows(page: Page) -> None:
    """Assert that a zoomed chart follows the time until the reader drags it."""
    zoom = "([from, to]) => { Object.assign(tca.chart, { from, to }); tca.chart.draw(); }"
    seen = "[...tca.chart.window, tca.chart.time]"
    page.evaluate(zoom, [3.0, 4.0])
    page.locator("#play").click()
    for _ in range(20):
        page.clock.run_for(100)
        start, end, time = page.evaluate(seen)
        assert start <= time <= end
        assert end - start == pytest.approx(1.0)
    assert start > 4
    chart = page.locator("#chart")
    for _ in range(2):  # drag the past into sight, nearly two windows back
        chart.hover(position={"x": 200, "y": 60})
        page.mouse.down()
        page.mouse.move(1390, chart.bounding_box()["y"] + 60)  # type: ignore[index]
        page.clock.run_for(100)
        page.mouse.up()
    page.mouse.move(100, 100)
    page.clock.run_for(700)
    *panned, time = page.evaluate(seen)
    assert panned[1] < time
    page.clock.run_for(500)
    assert page.evaluate(seen)[:2] == panned  # the chart stays there
    page.keyboard.press("Space")
    page.keyboard.press("Space")  # a new start of the play follows again
    page.clock.run_for(100)
    start, end, time = page.evaluate(seen)
    assert start <= time <= end


@pytest.mark.soak
def test_zoomed_chart_follows_the_steps(open_page: OpenPage, quiet: Path) -> None:
    page = open_page(quiet, "#t=2")
    expect(page.locator("#clock")).to_have_text("2.000 s")
    page.evaluate("Object.assign(tca.chart, { from: 1.5, to: 2.5 })")
    for key, time in (("ArrowRight", 11), ("ArrowRight", 3600), ("ArrowLeft", 11), ("End", 3601)):
        page.keyboard.press(key)
        start, end = page.evaluate("tca.chart.window")
        assert start <= time <= end
        assert end - start == pytest.approx(1.0)
