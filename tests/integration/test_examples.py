"""Every example runs, is short, and prints what ``examples/printed`` says."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from docs.examples import EXAMPLES, agrees
from module.real_central import RealCentral
from processes import run

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_prints_the_expected_lines(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 70
    with TemporaryDirectory() as folder, RealCentral(f"ipc://{folder}/central.sock") as daemon:
        done = run(str(path), TCA_CENTRAL=daemon.address)
    assert done.returncode == 0, done.stderr
    printed = done.stdout
    assert agrees(path.stem, printed), printed
    if path.stem == "03_plan_ahead":
        diary = printed.splitlines()
        assert [line for line in diary if "plan" in line] == [f"plan row {row}" for row in range(4)]
        assert [line for line in diary if "mow" in line] == [f"mow row {row}" for row in range(4)]
        for row in range(3):
            assert diary.index(f"plan row {row + 1}") < diary.index(f"mow row {row}")
        for row in range(2):
            assert diary.index(f"mow row {row}") < diary.index(f"plan row {row + 2}")
