"""Hostile bytes for each target of fuzz/. Every run tries the same few inputs; ``make soak`` fuzzes
for minutes.
"""

import re
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from dev.fuzz.targets import TARGETS

ROOT = Path(__file__).parents[1]
INPUTS = {
    "central": 40,
    "packets": 15,
    "session": 80,
    "journal": 60,
    "image": 40,
    "inputs": 40,
    "toml": 40,
}
"""Random inputs for slow targets; others get 200."""
SECONDS = {"central": 300, "packets": 120, "session": 120}
"""Seconds for large targets; others get 60."""


@pytest.mark.parametrize("name", TARGETS)
def test_random_bytes_raise_no_exception(name: str, request: pytest.FixtureRequest) -> None:
    target, first = TARGETS[name], 0
    if request.config.getoption("--new-lives"):
        first = Random().randrange(1 << 30)
    for seed in target.seeds()[:10]:
        target.attack(seed)
    for number in range(first, first + INPUTS.get(name, 200)):
        chance = Random(number)
        data = chance.randbytes(chance.randrange(target.most // 2) + 1)
        try:
            target.attack(data)
        except Exception as error:
            error.add_note(f"input {number} of {name}: {data.hex()}")
            raise


@pytest.mark.soak
@pytest.mark.parametrize("name", TARGETS)
def test_fuzzer_finds_no_exception(name: str, tmp_path: Path) -> None:
    pytest.importorskip(
        "atheris",
        reason="atheris has wheels for Linux on x86-64 only: pip install 'tca-central[fuzz]'",
    )
    command = [
        sys.executable,
        "-m",
        "dev.fuzz",
        name,
        "--seconds",
        str(SECONDS.get(name, 60)),
        "--faults",
        str(tmp_path),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    runs, reached = re.findall(r"#(\d+)\s+DONE\s+cov: (\d+)", done.stderr)[0]
    print(
        f"\n{name}: {int(runs):,} inputs, {int(runs) // SECONDS.get(name, 60):,} a second, {reached} places reached"
    )
    assert int(runs) > 100
