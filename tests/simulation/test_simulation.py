"""Simulated lives of a town keep every promise in spite of faults. A seed determines each life."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from simulation.life import Life
from simulation.log_life import LogLife


def live(seeds: range, kind: type[Life] = Life) -> dict[str, int]:
    """Run a life for each seed, and count events."""
    counts: dict[str, int] = {}
    option = " --log" * (kind is LogLife)
    for seed in seeds:
        life = kind(seed)
        try:
            life.run()
        except Exception as error:
            error.add_note(f"python -m tests.simulation{option} --seed {seed} --trace")
            raise
        for name, number in [*life.outside.counts.items(), ("crashes", life.daemon.crashes)]:
            counts[name] = counts.get(name, 0) + number
    return counts


def test_simulated_crashes_lose_and_repeat_no_task() -> None:
    counts = live(range(60, 84))
    assert (
        min(
            counts[name]
            for name in ("acknowledged", "crashes", "died", "lost by module", "locks", "retries")
        )
        > 0
    )


def test_members_of_a_log_lose_and_repeat_no_task() -> None:
    counts = live(range(300, 309), LogLife)
    names = ("acknowledged", "terms", "Deposed", "LogUnreachable", "moves")
    assert min(counts[name] for name in names) > 0


@pytest.mark.soak
@pytest.mark.parametrize("part", range(10))
def test_members_of_a_log_lose_and_repeat_no_task_in_many_lives(
    part: int, request: pytest.FixtureRequest
) -> None:
    is_new = bool(request.config.getoption("--new-lives"))
    first = random.SystemRandom().randrange(1 << 40) if is_new else 1000 + part * 1000
    live(range(first, first + 1000), LogLife)


@pytest.mark.soak
@pytest.mark.parametrize("part", range(10))
def test_simulated_crashes_lose_and_repeat_no_task_in_many_lives(
    part: int, request: pytest.FixtureRequest
) -> None:
    is_new = bool(request.config.getoption("--new-lives"))
    first = random.SystemRandom().randrange(1 << 40) if is_new else 1000 + part * 5000
    live(range(first, first + 5000))


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(1, 9))
def test_central_survives_a_crash_at_each_step_of_a_turn(seed: int) -> None:
    quiet = Life(seed)
    quiet.options.central_crashes = 0.0
    steps = quiet.run().daemon.steps
    for step in range(1, steps + 1):
        life = Life(seed)
        life.options.central_crashes, life.options.crash_at = 0.0, step
        life.run()


def test_seed_determines_each_simulated_life() -> None:
    assert len({LogLife(2).run().clockwork.digest for _ in range(2)}) == 1
    digests = [Life(seed).run().clockwork.digest for seed in (1, 2, 3)]
    assert [Life(seed).run().clockwork.digest for seed in (1, 2, 3)] == digests
    root = Path(__file__).parent.parent.parent
    command = [
        sys.executable,
        "-m",
        "tests.simulation",
        "--first",
        "1",
        "--lives",
        "3",
        "--digests",
    ]
    run = subprocess.run(
        command,
        cwd=root,
        env={**os.environ, "PYTHONHASHSEED": "7"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split()[:3] == digests
