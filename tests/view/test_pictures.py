"""Pictures that modules publish as variables, as they were at the time shown."""

import base64
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect
from tools.story import Story

from tca_wire.vocabulary import MessageClass
from view.answers import answer
from view.conftest import OpenPage, until

pytestmark = pytest.mark.slow

PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAMAAAACCAIAAAASFvFNAAAADUlEQVR4nGNgwAcAAB4AAY6hUpQAAAAASUVORK5CYII="
)


def svg(width: int) -> str:
    """Return a picture with a script that the page must not run."""
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="9"><script>parent.ran = true</script></svg>'


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """Return a journal with pictures of an arm at 1 s and 3 s, and of a map at 2 s. Another value
    follows at 4 s.
    """
    story = Story().module("arm", "reach")
    values = [
        (1.0, "arm", svg(11)),
        (2.0, "map", PNG),
        (3.0, "arm", svg(33)),
        (4.0, "mind", {"svg": svg(1)}),
    ]
    for time, name, value in values:
        story.at(time).received(f"picture of {name}", MessageClass.VARIABLE, "arm", data=value)
    story.at(5.0).received("speed of arm", MessageClass.VARIABLE, "arm", data=svg(5))
    return story.at(6.0).write(tmp_path / "arm")


def widths(page: Page) -> Any:
    """Return the natural widths of the visible pictures, by name."""
    return page.evaluate(
        """() => Object.fromEntries([...document.querySelectorAll('#pictures details:not([hidden])')].map(
          (box) => [box.querySelector('summary').textContent, box.querySelector('img').naturalWidth]))"""
    )


def test_pictures_belong_to_the_shown_time(open_page: OpenPage, arm: Path) -> None:
    page = open_page(arm, "#t=0.5")
    expect(page.locator("#pictures")).to_be_hidden()
    for time, expected in (
        (1.5, {"picture of arm": 11}),
        (3.5, {"picture of arm": 33, "picture of map": 3}),
        (2.5, {"picture of arm": 11, "picture of map": 3}),
    ):
        page.evaluate("(time) => { location.hash = `#t=${time}`; }", time)
        until(
            page,
            """(expected) => [...document.querySelectorAll('#pictures details:not([hidden]) img')].map((one) => one.naturalWidth).join() === expected""",
            ",".join(map(str, expected.values())),
        )
        assert widths(page) == expected
    assert page.evaluate("() => window.ran") is None


@pytest.mark.soak
def test_closed_picture_is_fetched_when_opened(open_page: OpenPage, arm: Path) -> None:
    page = open_page(arm, "#t=1.5")
    picture = page.locator("#pictures details").first
    until(page, "() => document.querySelector('#pictures img').naturalWidth === 11")
    picture.locator("summary").click()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.evaluate("() => { location.hash = '#t=3.5'; }")
    until(page, "() => document.querySelectorAll('#pictures img')[1]?.naturalWidth === 3")
    assert page.evaluate("() => document.querySelector('#pictures img').naturalWidth") == 11
    picture.locator("summary").click()
    until(page, "() => document.querySelector('#pictures img').naturalWidth === 33")
    assert len([url for url in asked if "api/picture/" in url]) == 2


@pytest.mark.soak
def test_other_values_are_not_pictures(open_page: OpenPage, arm: Path) -> None:
    page = open_page(arm)
    box = page.locator("#pictures details", has_text="picture of mind")
    expect(box.locator("p")).to_have_text("this value is neither SVG as text nor PNG as bytes")
    expect(box.locator("img")).to_be_hidden()
    expect(page.locator("#pictures details")).to_have_count(3)


def test_server_serves_picture_values_only(serve: Callable[[Path], str], arm: Path) -> None:
    address = serve(arm)
    kind, data = answer(f"{address}api/picture/1")["image"].split(",")
    assert (kind, base64.b64decode(data).decode()) == ("data:image/svg+xml;base64", svg(11))
    for nothing in (5, 77):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{address}api/picture/{nothing}", timeout=20)
