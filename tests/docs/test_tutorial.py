"""The tutorial works as printed: each page is played from an empty folder, and its types are right."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from docs.pages import ROOT, blocks
from docs.steps import steps_of

from docs.tutorial import PAGES, TutorialPlayer, save_files

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _no_central_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TCA_CENTRAL", raising=False)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_of_the_tutorial_works_as_printed(page: Path, tmp_path: Path, rewrite: bool) -> None:
    TutorialPlayer(page, tmp_path, rewrite=rewrite).play(steps_of(blocks(page)))


def test_programs_of_each_page_have_the_right_types(tmp_path: Path) -> None:
    options = ["--config-file=", "--strict", "--follow-imports=silent", "--cache-dir", ".types"]
    for page in PAGES:
        save_files(page, tmp_path)
        programs = sorted(path.name for path in tmp_path.glob("*.py"))
        done = subprocess.run(
            [sys.executable, "-m", "mypy", *options, *programs],
            cwd=tmp_path,
            env={**os.environ, "MYPYPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{page.name}: {done.stdout}"


def test_pages_have_450_to_600_words() -> None:
    words = {page.name: len(page.read_text().split()) for page in PAGES}
    assert {name: count for name, count in words.items() if not 450 <= count <= 600} == {}
