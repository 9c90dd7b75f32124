"""The tutorial works as printed: each page is played from an empty folder."""

from pathlib import Path

import pytest

from docs.tutorial import PAGES, Player

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_of_the_tutorial_works_as_printed(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rewrite: bool
) -> None:
    monkeypatch.delenv("TCA_CENTRAL", raising=False)
    Player(page, tmp_path, rewrite=rewrite).play()
