"""What the tools tell of small runs, which are worked out by hand: each text of told/ has many of a
theme.

``pytest --rewrite`` writes the answers anew: commit only what you can explain.
"""

from pathlib import Path

import pytest
from tools.telling import told

FILES = sorted(Path(__file__).with_name("told").glob("*.txt"))
RUNS = [(path, text.strip()) for path in FILES for text in path.read_text().split("\n\n")]


@pytest.mark.parametrize(
    ("path", "text"),
    RUNS,
    ids=lambda one: one.stem if isinstance(one, Path) else one.split("\n")[0],
)
def test_answers_match_the_approved_text(path: Path, text: str, rewrite: bool) -> None:
    found = told(text)
    if rewrite:
        path.write_text(path.read_text().replace(text, found))
    assert found == text
