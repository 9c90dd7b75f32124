"""The report's chart in a real browser: legible on wide and narrow screens and on paper."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner
from playwright.sync_api import Browser, Page
from tools.story import Story

from tca_tools.report.__main__ import report

pytestmark = pytest.mark.slow

LEAST = 9  # the least line height of letters in pixels
LETTERS = "(root) => Math.min(...[...document.querySelectorAll(`${root} text`)].map((one) => one.getBoundingClientRect().height))"
INSIDE = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"


def long_walk() -> Story:
    """Return a story of many short moves of modules with long names. Its chart has the greatest
    width.
    """
    story = Story()
    for number in range(8):
        story.module(f"gait planner of the {number}th leg", f"move {number}")
    for number in range(160):
        story.at(round(number * 0.5, 6)).acted(
            story.command(f"move {number % 8}", "user"),
            f"gait planner of the {number % 8}th leg",
            0.02,
        )
    return story


def pool() -> Story:
    """Return two copies of a program, with many wide letters in the longest name."""
    story = Story().module("arm", "pick").module("arm#2", "pick", resource="arm").at(1.0)
    story.acted(story.command("pick", "user"), "arm", 1.0)
    return story.acted(story.command("pick", "user"), "arm#2", 1.0)


@pytest.fixture(params=[long_walk, pytest.param(pool, marks=pytest.mark.soak)])
def paged(request: pytest.FixtureRequest, browser: Browser, tmp_path: Path) -> Iterator[Page]:
    """Open the page of a report."""
    out = tmp_path / "run.html"
    assert (
        CliRunner()
        .invoke(report, [str(request.param().write(tmp_path / "run")), "-o", str(out)])
        .exit_code
        == 0
    )
    context = browser.new_context()
    page = context.new_page()
    page.goto(out.as_uri())
    yield page
    context.close()


def scrolls(page: Page) -> float:
    """Return how far the chart can be scrolled, in pixels."""
    return float(page.locator(".r-scroll").evaluate("(one) => one.scrollWidth - one.clientWidth"))


def left_of(page: Page, what: str) -> float:
    box = page.locator(what).bounding_box()
    assert box is not None
    return box["x"]


def test_report_chart_is_legible_on_screen_and_paper(paged: Page) -> None:
    for width in (2400, 1400):
        assert_as_wide_as_the_screen(paged, width)
    for width in (2400, 900):
        assert_whole_labels(paged, width)
    for width in (900, 420):
        assert_scrolls_beside_its_labels(paged, width)
    assert_strips_on_paper(paged)


def assert_as_wide_as_the_screen(paged: Page, width: int) -> None:
    paged.set_viewport_size({"width": width, "height": 900})
    assert paged.evaluate(INSIDE)
    assert scrolls(paged) == 0
    assert paged.evaluate(LETTERS, ".r-plot") >= LEAST
    chart, text = (
        paged.locator(what).bounding_box() for what in (".r-chart", "main > h2 >> nth=0")
    )
    assert chart is not None
    assert text is not None
    assert chart["width"] > text["width"] + (300 if width > 2000 else 100)
    assert chart["x"] + chart["width"] <= width


def assert_whole_labels(paged: Page, width: int) -> None:
    paged.set_viewport_size({"width": width, "height": 900})
    left = left_of(paged, "#r-labels")
    labels = paged.locator("#r-labels text").all()
    assert labels
    for label in labels:
        box = label.bounding_box()
        assert box is not None
        assert box["x"] >= left, label.text_content()


def assert_scrolls_beside_its_labels(paged: Page, width: int) -> None:
    paged.set_viewport_size({"width": width, "height": 900})
    assert paged.evaluate(INSIDE)
    assert scrolls(paged) > 0
    assert paged.evaluate(LETTERS, ".r-plot") >= LEAST
    paged.locator(".r-scroll").evaluate("(one) => { one.scrollLeft = 0; }")
    labels, plot = left_of(paged, "#r-labels"), left_of(paged, "#r-plot")
    paged.locator(".r-scroll").evaluate("(one) => { one.scrollLeft = 40; }")
    assert left_of(paged, "#r-labels") == labels
    assert left_of(paged, "#r-plot") == pytest.approx(plot - 40, abs=1)


def assert_strips_on_paper(paged: Page) -> None:
    paged.emulate_media(media="print")
    paged.set_viewport_size({"width": 1032, "height": 700})  # A4, landscape, without its margins
    assert paged.evaluate(INSIDE)
    strips = paged.locator(".r-strip").count()
    shown = ".r-strip" if strips else ".r-plot"
    assert strips != 1
    if not strips:
        assert paged.evaluate(LETTERS, shown) >= LEAST
    widths = [box["width"] for one in paged.locator(shown).all() if (box := one.bounding_box())]
    assert all(1000 < width <= 1032 for width in widths)
    for one in paged.locator(".r-strip").all():
        scale = one.evaluate("(one) => one.children[1].getScreenCTM().a")
        assert scale >= 0.75  # of 12 pixels
        assert (
            one.evaluate(
                "(one) => Math.abs(one.children[0].getScreenCTM().a - one.children[1].getScreenCTM().a)"
            )
            < 0.02
        )
    assert paged.pdf(prefer_css_page_size=True).startswith(b"%PDF")
