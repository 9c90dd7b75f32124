"""The page that ``tca gantt -o run.html`` writes, in a real browser."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from playwright.sync_api import Browser
from tools.story import Story

from tca_tools.gantt.__main__ import gantt
from view.conftest import until
from view.test_report_chart import long_walk

pytestmark = pytest.mark.slow

EDGE = "document.querySelector('.zoomed').getBoundingClientRect().right"
ROOM = "document.querySelector('main').getBoundingClientRect().left + document.querySelector('main').clientWidth"
IS_FITTED = f"() => Math.abs({EDGE} - ({ROOM})) < 1"


def test_chart_opens_at_window_width_and_zooms(browser: Browser, tmp_path: Path) -> None:
    page_file = tmp_path / "run.html"
    result = CliRunner().invoke(
        gantt, [str(long_walk().write(tmp_path / "run")), "-o", str(page_file)]
    )
    assert result.exit_code == 0
    for width in (900, 2200):
        page = browser.new_page(viewport={"width": width, "height": 700})
        page.goto(page_file.as_uri())
        assert page.evaluate(IS_FITTED), width
        page.click("text=+")
        assert not page.evaluate(IS_FITTED)
        page.click("text=all")
        assert page.evaluate(IS_FITTED)
        page.set_viewport_size({"width": width + 200, "height": 700})
        until(page, IS_FITTED)
        page.close()


PLOT = """() => {
  const box = document.querySelector('.zoomed').getBoundingClientRect();
  return [box.left, box.right];
}"""
LABELS = """() => [...document.querySelectorAll('.tick')].map((one) => one.getBoundingClientRect())
  .filter((box) => box.width).flatMap((box) => [box.left, box.right])"""


@pytest.mark.soak
def test_axis_labels_are_whole_at_the_edges(browser: Browser, tmp_path: Path) -> None:
    story = Story().module("legs", "walk")
    walk = story.goal("walk", "user")
    run = story.delivered(walk, "legs").at(160.0).returned(walk).write(tmp_path / "run")
    page_file = tmp_path / "run.html"
    assert (
        CliRunner()
        .invoke(gantt, [str(run), "--from", "0", "--to", "160", "-o", str(page_file)])
        .exit_code
        == 0
    )
    for width in (900, 2000):
        page = browser.new_page(viewport={"width": width, "height": 700})
        page.goto(page_file.as_uri())
        left, right = page.evaluate(PLOT)
        edges = page.evaluate(LABELS)
        assert left - 1 <= min(edges) < left + 30, width
        assert right - 30 < max(edges) <= right + 1, width
        page.close()


SEEN = """() => {
  const right = (one) => one.getBoundingClientRect().right;
  return [right(document.getElementById('fixed')), right(document.querySelector('main'))];
}"""


def test_bar_wider_than_the_window_has_its_name(browser: Browser, tmp_path: Path) -> None:
    """The chart shows eight seconds amid a walk of three minutes, then the end of the walk."""
    story = Story().module("legs", "walk").module("eyes", "look").at(10.0)
    walk, look = story.goal("walk", "user"), story.goal("look", "user")
    story.delivered(walk, "legs").at(20.0).delivered(look, "eyes").at(40.0).returned(look).at(
        190.0
    ).returned(walk)
    page_file = tmp_path / "run.html"
    assert (
        CliRunner()
        .invoke(gantt, [str(story.write(tmp_path / "run")), "-o", str(page_file)])
        .exit_code
        == 0
    )
    page = browser.new_page(viewport={"width": 1000, "height": 700})
    page.goto(page_file.as_uri())
    name = page.locator("text.on", has_text="walk")
    at_first = name.get_attribute("x")
    for _ in range(5):
        page.click("text=+")
    left, right = page.evaluate(SEEN)
    box = name.bounding_box()
    assert box
    assert left <= box["x"] < left + 30
    assert box["x"] + box["width"] < right
    before = name.get_attribute("x")
    page.evaluate("document.querySelector('main').scrollLeft = 1e9")
    until(page, "(old) => document.querySelector('text.on').getAttribute('x') !== old", before)
    box = name.bounding_box()
    end = page.locator("rect", has_text="walk").last.bounding_box()
    assert box
    assert end
    assert box["x"] + box["width"] <= end["x"] + end["width"]
    page.click("text=all")
    assert name.get_attribute("x") == at_first
    page.close()
