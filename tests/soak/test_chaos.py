"""Chaos with real processes: a thousand kills of central, in lives of a robot under load.

Run one more life: ``python -m tests.chaos --seed 7``.
"""

import time
from collections import Counter
from pathlib import Path

import pytest
from chaos.checker import Judge
from chaos.life import Life

pytestmark = pytest.mark.soak

LIVES, KILLS = 25, 40


@pytest.mark.parametrize("number", range(LIVES))
def test_chaos_loses_and_repeats_no_task(
    number: int, request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    is_new = bool(request.config.getoption("--new-lives"))
    seed = time.time_ns() // 1000 if is_new else number
    life = Life(tmp_path, seed, KILLS)
    life.run()
    judge = Judge(tmp_path)
    counts: Counter[str] = life.counts + judge.counts
    with capsys.disabled():
        print(
            f"\nseed {seed}:",
            ", ".join(f"{name} {count}" for name, count in sorted(counts.items())),
        )
    assert not judge.wrong
    assert counts["kills of central"] == KILLS
