"""Chaos with a replicated log: five hundred takeovers, in lives of a robot under load.

Run one more life: ``python -m tests.chaos.takeovers --seed 7``.
"""

import time
from pathlib import Path

import pytest
from chaos.takeovers import live

pytestmark = pytest.mark.soak

LIVES, TAKEOVERS = 20, 25


@pytest.mark.parametrize("number", range(LIVES))
def test_takeovers_lose_and_repeat_no_task_in_many_lives(
    number: int, request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    is_new = bool(request.config.getoption("--new-lives"))
    seed = time.time_ns() // 1000 if is_new else number
    counts, wrong = live(tmp_path, seed, TAKEOVERS)
    with capsys.disabled():
        print(
            f"\nseed {seed}:",
            ", ".join(f"{name} {count}" for name, count in sorted(counts.items())),
        )
    assert not wrong
    assert counts["takeovers"] >= TAKEOVERS
