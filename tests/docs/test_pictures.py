"""The pictures of the documents are those that ``make pictures`` makes, and they are small."""

import re
from pathlib import Path

import pytest
from docs.pages import PAGES, ROOT

from dev.scripts.pictures import CHROMIUM, IMAGES, LARGEST, PICTURES, WORK

RECORDS = sorted((ROOT / "dev/records").glob("*.md"))
SAME_EACH_TIME = ("life-cycle.svg", "state-machine.svg")
"""Pictures without times."""


def test_pages_show_exactly_the_made_pictures() -> None:
    shown = {
        name
        for page in (*PAGES, *RECORDS)
        for name in re.findall(r"images/([\w-]+\.(?:svg|png|webp))\b", page.read_text())
    }
    assert shown == set(PICTURES)


def test_folder_has_exactly_the_made_pictures() -> None:
    assert {file.name for file in IMAGES.iterdir()} == set(PICTURES)


def test_pictures_are_small() -> None:
    assert [file.name for file in IMAGES.iterdir() if file.stat().st_size > LARGEST] == []


@pytest.mark.slow
@pytest.mark.soak
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: install the package 'chromium'")
@pytest.mark.parametrize("name", PICTURES)
def test_picture_is_made_from_a_real_run(name: str, tmp_path: Path) -> None:
    WORK.mkdir(parents=True, exist_ok=True)
    PICTURES[name](tmp_path / name)
    assert 0 < (tmp_path / name).stat().st_size <= LARGEST
    if name in SAME_EACH_TIME:
        assert (tmp_path / name).read_text() == (IMAGES / name).read_text()
