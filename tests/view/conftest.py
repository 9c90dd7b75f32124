"""A served journal, and a real browser to look at it with."""

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from view.served import served

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SOON = 60_000  # milliseconds: a busy machine reads 100,000 tasks in ten seconds

expect.set_options(timeout=SOON)

Look = Callable[..., Page]


def until(page: Page, holds: str, arg: object = None) -> None:
    """Waits for what JavaScript says. Playwright's own wait evaluates in the page, which the page's policy forbids."""
    end = time.monotonic() + SOON / 1000
    while not page.evaluate(holds, arg):
        assert time.monotonic() < end, holds


def written(page: Page) -> list[tuple[str, str]]:
    """What the chart writes when it is drawn, each with its colour."""
    told: list[list[str]] = page.evaluate(
        """() => {
          const { chart } = tca, { context } = chart, told = [], fill = context.fillText;
          context.fillText = (text, ...where) => { told.push([text, context.fillStyle]); fill.call(context, text, ...where); };
          chart.draw();
          delete context.fillText;
          return told;
        }"""
    )
    return [(text, colour) for text, colour in told]


@pytest.fixture
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., str]]:
    """Serves journals, or without one the newest run, by real processes; gives each page's address."""
    with ExitStack() as processes:
        errors = tmp_path_factory.mktemp("served") / "errors.txt"

        def start(*journal: Path) -> str:
            return processes.enter_context(served([*map(str, journal), "--no-browser"], errors))

        yield start


@pytest.fixture(scope="package")  # while it is open an event loop runs, in which other tests could not
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium here: install the package 'chromium'")
    with sync_playwright() as playwright:
        options = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()


@pytest.fixture
def look(browser: Browser, serve: Callable[[Path], str]) -> Iterator[Look]:
    """Opens a journal, or an address, in the browser; nothing may go wrong in the page, or be fetched from elsewhere.

    With ``clock=True`` time passes in the page only with ``page.clock``.
    """
    context = browser.new_context(viewport={"width": 1400, "height": 860})
    context.set_default_timeout(SOON)
    wrong: list[str] = []

    def open_page(what: Path | str, hash_part: str = "", *, clock: bool = False) -> Page:
        address = what if isinstance(what, str) else serve(what)
        page = context.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda line: wrong.append(line.text) if line.type == "error" else None)
        page.on(
            "request", lambda asked: wrong.append(asked.url) if not asked.url.startswith((address, "data:")) else None
        )
        if clock:
            page.clock.install()
        page.goto(address + hash_part)
        page.wait_for_selector("#status:not(:has-text('reading'))")
        return page

    yield open_page
    context.close()
    assert not wrong
