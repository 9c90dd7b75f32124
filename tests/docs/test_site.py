"""The site builds without warnings: links, anchors and quoted files exist, docstrings are whole.

The quick suite leaves this to ``make lint``, which builds the site, too.
"""

import json

import pytest

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
