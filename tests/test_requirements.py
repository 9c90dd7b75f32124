"""Each test that dev/records/task-state-pattern.md names for a requirement exists."""

import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
PAGE = (TESTS.parent / "dev/records/task-state-pattern.md").read_text()
ROWS = [line for line in PAGE.splitlines() if line.startswith("| ") and "| test |" not in line]
NAMED = re.findall(r"`(\w+/\w+(?:::\w+)?)`", "\n".join(ROWS))


def test_every_requirement_names_a_test() -> None:
    assert len(ROWS) > 40
    assert [row for row in ROWS if not re.search(r"`\w+/\w+(::\w+)?`[^|]*\|$", row)] == []


@pytest.mark.parametrize("name", sorted(set(NAMED)))
def test_named_by_a_requirement_exists(name: str) -> None:
    place, _, test = name.partition("::")
    if test:
        assert f"def {test}(" in (TESTS / f"{place}.py").read_text()
    else:
        assert (TESTS / "central" / f"{place}.txt").exists()
