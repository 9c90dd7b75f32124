"""The plain walk from the command line."""

import re
from pathlib import Path

import pytest

from robots.ambler_sim.snapshot import load_snapshot
from robots.ambler_sim.walk_alone import main


def test_two_metres_take_four_steps(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    picture = tmp_path / "walk.svg"
    assert main(["--metres", "2", "--backend", "kinematic", "--picture", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len([line for line in lines if line.startswith("step")]) == 4
    assert re.match(r"walked 2\.0\d m in 4 steps with kinematic: max tilt 0\.\d\d deg, min stability", lines[-2])
    assert picture.exists()


def test_a_second_walk_goes_on_where_the_first_one_ended(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    state = tmp_path / "robot.json"
    for _ in range(2):
        assert main(["--metres", "0.5", "--backend", "kinematic", "--state", str(state)]) == 0
    saved = load_snapshot(state)
    assert saved is not None
    assert saved.posture.x == pytest.approx(1.0, abs=0.05)
    assert [foot.leg for foot in saved.trail[6:]] == [2, 5]
    assert "walked 0.5" in capsys.readouterr().out


def test_a_curve_that_is_too_tight_ends_with_one_line_that_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--metres", "4", "--curvature", "1.0", "--backend", "kinematic"]) == 1
    assert capsys.readouterr().err.startswith("walk_alone: NoFootfall: no foothold for leg")
