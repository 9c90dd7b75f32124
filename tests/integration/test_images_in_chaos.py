"""Programs that exchange images are killed, stopped and restarted at random, and so is central.

Nothing hangs, nothing is left, no command runs twice, and no receiver sees a damaged image.
"""

import sys
import time
from pathlib import Path

import pytest
import sampling
from chaos.image_life import live
from processes import TESTS, Process

pytestmark = pytest.mark.slow

LIVES, FAULTS = sampling.lives(1, 6), sampling.lives(6, 50)
SIZES = 100_000, 1_000_000, 6_000_000


def seed_of(number: int) -> int:
    return time.time_ns() // 1000 if sampling.in_the_soak else number


@pytest.mark.parametrize("number", range(LIVES))
def test_chaos_damages_and_repeats_no_image(number: int, tmp_path: Path) -> None:
    seed, size = seed_of(number), SIZES[(number + 1) % 3]
    print(f"seed {seed}:", dict(live(str(tmp_path), seed, FAULTS, size)))


@pytest.mark.soak
def test_chaos_with_lost_memory_damages_no_image(tmp_path: Path) -> None:
    seed = seed_of(3)
    print(f"seed {seed}:", dict(live(str(tmp_path), seed, FAULTS, 1_000_000, loses_memory=True)))


@pytest.mark.soak
def test_chaos_in_full_memory_damages_no_image(tmp_path: Path) -> None:
    seed = seed_of(7)
    text = f"from chaos.image_life import live\nlive({str(tmp_path)!r}, {seed}, {FAULTS}, 1_000_000, has_full_memory=True)"
    mount = 'mount -t tmpfs -o size=50m none /dev/shm && exec "$@"'
    unshared = ["--mount", "--user", "--map-root-user", "sh", "-c", mount, "sh"]
    path = {"PYTHONPATH": f"{TESTS}:{TESTS.parent}"}
    with Process(
        "/usr/bin/unshare", *unshared, sys.executable, "-c", text, environment=path
    ) as process:
        output, errors = process.communicate(timeout=600)
    if "unshare:" in errors or "mount:" in errors:
        pytest.skip(f"no user namespaces here: {errors}")
    assert process.wait() == 0, f"seed {seed}: {errors}{output}"
