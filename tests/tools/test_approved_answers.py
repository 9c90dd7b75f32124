"""Answers of the tools about small runs, worked out by hand. Each file of told/ has one theme.

``pytest --rewrite`` replaces the answers. Commit only answers that you can explain.
"""

from pathlib import Path

import pytest
from tools.telling import answered

FILES = sorted(Path(__file__).with_name("told").glob("*.txt"))
RUNS = [(path, text.strip()) for path in FILES for text in path.read_text().split("\n\n")]


@pytest.mark.parametrize(
    ("path", "text"),
    RUNS,
    ids=lambda one: one.stem if isinstance(one, Path) else one.split("\n")[0],
)
def test_answers_match_the_approved_text(path: Path, text: str, rewrite: bool) -> None:
    found = answered(text)
    if rewrite:
        path.write_text(path.read_text().replace(text, found))
    assert found == text
