"""The site builds without warnings: links, anchors and quoted files exist, docstrings are whole.

The quick suite leaves this to ``make lint``, which builds the site, too.
"""

import json
import shutil
import time

import pytest
from playwright.sync_api import sync_playwright
from waiting import SOON

from dev.site import __main__ as docs
from dev.site.root import SITE

pytestmark = [pytest.mark.slow, pytest.mark.soak]


@pytest.fixture(scope="module")
def built() -> str:
    return docs.build()


def test_site_builds_without_warnings(built: str) -> None:
    assert built == ""


def test_search_of_the_site_leaves_out_records(built: str) -> None:
    found = {one["location"] for one in json.loads((SITE / "search.json").read_text())["items"]}
    assert "index.html" in found
    assert not [place for place in found if place.startswith(docs.RECORDS)]
    assert (SITE / "decisions").is_dir()


@pytest.mark.usefixtures("built")
def test_search_works_from_a_folder() -> None:
    """The page may load nothing from a server."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no Chromium here: install the package 'chromium'")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        context = browser.new_context(offline=True)
        page = context.new_page()
        page.goto((SITE / "index.html").as_uri())
        page.locator(".md-search__button").first.click()
        box = page.get_by_placeholder("Search")
        found = page.get_by_text("Set a deadline").filter(visible=True)
        assert not found.count()
        until = time.monotonic() + SOON
        while not found.count():
            assert time.monotonic() < until, "nothing is found"
            box.fill("")  # the page ignores what is typed before it is ready
            box.press_sequentially("deadline")
            page.wait_for_timeout(500)
        browser.close()
