"""A served journal, and a real browser for its page."""

import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import uvicorn
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from tca_tools.journal.journals import Log, open_log
from tca_tools.view.app import Steering, application
from tca_tools.view.runs import Runs

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
SOON = 60_000  # milliseconds: a busy machine reads 100,000 tasks in ten seconds

expect.set_options(timeout=SOON)

OpenPage = Callable[..., Page]


def until(page: Page, holds: str, arg: object = None) -> None:
    """Wait until a JavaScript expression holds.

    Playwright's own wait function evaluates in the page, which the page's policy forbids.
    """
    end = time.monotonic() + SOON / 1000
    while not page.evaluate(holds, arg):
        assert time.monotonic() < end, holds
        time.sleep(0.01)


def written(page: Page) -> list[tuple[str, str]]:
    """Return the texts that the chart draws, each with its colour."""
    texts: list[list[str]] = page.evaluate(
        """() => {
          const { chart } = tca, { context } = chart, told = [], fill = context.fillText;
          context.fillText = (text, ...where) => { told.push([text, context.fillStyle]); fill.call(context, text, ...where); };
          chart.draw();
          delete context.fillText;
          return told;
        }"""
    )
    return [(text, colour) for text, colour in texts]


@contextmanager
def served(log: Log, *, follows: bool = False, steering: Steering | None = None) -> Iterator[str]:
    """Serve a page in a thread. Yield the page's address."""
    log.check_beginning()
    runs = Runs(log, follows=follows)
    server = uvicorn.Server(
        uvicorn.Config(application(runs, ["127.0.0.1", "localhost"], steering), log_level="warning")
    )
    with socket.create_server(("127.0.0.1", 0)) as door:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [door]})
        runs.show(None)
        thread.start()
        try:
            yield f"http://127.0.0.1:{door.getsockname()[1]}/"
        finally:
            runs.stop()
            server.should_exit = True
            thread.join()


@pytest.fixture
def serve() -> Iterator[Callable[..., str]]:
    """Yield a function that serves a journal (default: the newest run) and returns the page's
    address.
    """
    with ExitStack() as servers:
        yield lambda journal=None, steering=None: servers.enter_context(
            served(open_log(journal), follows=journal is None, steering=steering)
        )


@pytest.fixture(scope="package")  # the browser's event loop disturbs tests of other packages
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium here: install the package 'chromium'")
    with sync_playwright() as playwright:
        options = [
            "--no-sandbox",
            "--disable-gpu",
            "--disable-background-networking",
            "--in-process-gpu",
        ]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()


@pytest.fixture(scope="package")
def window(browser: Browser) -> BrowserContext:
    """Return a window with one page for all tests. A new window for each test takes far longer."""
    return browser.new_context()


@pytest.fixture
def open_page(
    browser: Browser, window: BrowserContext, serve: Callable[[Path], str]
) -> Iterator[OpenPage]:
    """Yield a function that opens a journal or an address in the browser, one page at a time.

    The test fails if the page has an error, or fetches from elsewhere. With ``clock=True`` time
    passes in the page only by ``page.clock``.
    """
    wrong: list[str] = []
    addresses: list[str] = ["data:", "about:"]
    with ExitStack() as at_last:

        def open_in_window(what: Path | str, hash_part: str = "", *, clock: bool = False) -> Page:
            addresses.append(what if isinstance(what, str) else serve(what))
            context = at_last.enter_context(browser.new_context()) if clock else window
            page = context.pages[0] if context.pages else context.new_page()
            if page.url != "about:blank":
                page.goto("about:blank")
            page.set_default_timeout(SOON)
            page.set_viewport_size({"width": 1400, "height": 860})
            for kind, note in notes.items():
                page.on(kind, note)  # type: ignore[call-overload]
                at_last.callback(page.remove_listener, kind, note)
            at_last.callback(leave, page)
            if clock:
                page.clock.install()
            page.goto(addresses[-1] + hash_part)
            page.wait_for_selector("#status:not(:has-text('reading'))")
            return page

        notes = {
            "pageerror": lambda error: wrong.append(str(error)),
            "console": lambda line: (
                wrong.append(line.text)
                if line.type == "error" and "(Forbidden)" not in line.text
                else None
            ),  # the page reports a refusal itself
            "request": lambda asked: (
                None if asked.url.startswith(tuple(addresses)) else wrong.append(asked.url)
            ),
        }
        yield open_in_window
    assert not wrong


def leave(page: Page) -> None:
    if not page.is_closed():
        page.unroute_all()
        page.emulate_media(color_scheme="null")
        page.goto("about:blank")
