"""Central moves between three computers, while its lines are cut: no task is lost or repeated."""

from pathlib import Path

import pytest
from chaos.takeovers import live

pytestmark = pytest.mark.slow

FAULTS = {"kill leader": 1, "cut leader": 1, "hold leader": 1}


def test_takeovers_lose_and_repeat_no_task(tmp_path: Path) -> None:
    counts, wrong = live(tmp_path, 2, 2, faults=FAULTS, seconds=[2.0])
    assert not wrong
    assert counts["takeovers"] >= 2
    assert counts["entries compared"] > 100
