"""Every example runs, is short, and prints what ``examples/printed`` says."""

import re
from pathlib import Path

import pytest
from module.real_central import RealCentral
from processes import run

pytestmark = pytest.mark.slow
EXAMPLES = Path(__file__).parents[2] / "examples"
PRINTED = EXAMPLES / "printed"
ANY_ORDER = {"03_plan_ahead", "21_start_up_order", "25_mutex", "55_on_leave"}
"""Examples of programs whose lines may come in another order."""


def matches(printed: str, expected: str) -> bool:
    """Compare an output with the expected one, where ``...`` stands for any text."""
    pattern = ".*".join(re.escape(part) for part in expected.split("..."))
    return re.fullmatch(pattern, printed, re.DOTALL) is not None


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_prints_the_expected_lines(path: Path, tmp_path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 70
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        done = run(str(path), TCA_CENTRAL=daemon.address)
    assert done.returncode == 0, done.stderr
    printed, expected = done.stdout, (PRINTED / f"{path.stem}.txt").read_text()
    if path.stem in ANY_ORDER:
        assert sorted(printed.splitlines()) == sorted(expected.splitlines())
    else:
        assert matches(printed, expected), printed
    if path.stem == "03_plan_ahead":
        diary = printed.splitlines()
        assert [line for line in diary if "plan" in line] == [f"plan row {row}" for row in range(4)]
        assert [line for line in diary if "mow" in line] == [f"mow row {row}" for row in range(4)]
        for row in range(3):
            assert diary.index(f"plan row {row + 1}") < diary.index(f"mow row {row}")
        for row in range(2):
            assert diary.index(f"mow row {row}") < diary.index(f"plan row {row + 2}")

