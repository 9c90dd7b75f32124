"""A coordinator with a preview on the page: its machine, and marks of early tasks."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page
from tools.deliveries import deliver, held_up, written

from view.answers import answer
from view.conftest import OpenPage, until

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def delivery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a delivery whose foreseen box is occupied after 2 s."""
    return written(deliver(1.0, changed=0.0), tmp_path_factory.mktemp("coordinator") / "delivery")


def marked(page: Page, kind: str, expected: str) -> None:
    script = """([kind, expected]) => [...document.querySelectorAll(`.machine .${kind}`)]
        .map((one) => one.querySelector("text").textContent.trim()).join(", ") === expected"""
    until(page, script, [kind, expected])


def test_machine_shows_its_preview_at_any_time(open_page: OpenPage, delivery: Path) -> None:
    page = open_page(delivery, "#t=1&task=2")
    page.wait_for_selector(".machine svg")
    picture = page.locator(".machine svg").element_handle()
    marked(page, "active", "going to B")
    marked(page, "foreseen", "arm to box B, dropping in B, tucking, going back, end")
    page.evaluate("() => { location.hash = '#t=3&task=2'; }")
    marked(page, "active", "going to B")
    marked(page, "foreseen", "going to C, arm to box C, dropping in C, tucking, going back, end")
    until(page, "() => document.querySelectorAll('.machine .edge.likely .likelihood').length === 6")
    page.evaluate("() => { location.hash = '#t=40&task=2'; }")
    marked(page, "active", "")
    marked(page, "foreseen", "")
    assert picture.evaluate("(one) => one.isConnected")  # not drawn again


@pytest.mark.soak
def test_tree_marks_early_work_as_known_at_the_time(open_page: OpenPage, delivery: Path) -> None:
    page = open_page(delivery, "#t=1&task=2")
    marks = "(expected) => [...document.querySelectorAll('.row .role')].map((one) => one.textContent).join('; ') === expected"
    for time, expected in (
        (1, "ahead"),
        (3, "ahead, wasted; ahead"),
        (20, "ahead, wasted; ahead, kept"),
    ):
        page.evaluate("(time) => { location.hash = `#t=${time}&task=2`; }", time)
        until(page, marks, expected)


def test_server_reports_which_states_are_likely(
    serve: Callable[[Path], str], delivery: Path
) -> None:
    address = serve(delivery)

    def asked(instant: float) -> Any:
        return answer(f"{address}api/message/2?at={instant}")["machine"]

    assert asked(3)["active"] == [1]
    assert asked(3)["late"][0].startswith("'going to C' did not start early")
    assert asked(3)["foreseen"] == [2, 4, 6, 7, 8, 9]
    assert set(asked(3)["likely"].values()) == {"100%"}
    assert asked(40) == {"active": [], "foreseen": [], "likely": {}}


@pytest.mark.soak
def test_page_says_why_activities_have_not_started(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(written(held_up(), tmp_path / "held up"), "#t=1&task=4")
    until(page, "() => document.querySelector('#task .late')?.textContent.includes('undo=')")
