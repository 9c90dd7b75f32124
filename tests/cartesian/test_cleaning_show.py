"""The complete demonstration, with its own central."""

import re
from pathlib import Path

import pytest
from processes import run


@pytest.mark.soak
def test_cleaning_show_cleans_the_wall(tmp_path: Path) -> None:
    shown = run("-m", "robots.cartesian_sim", "--out", str(tmp_path))
    assert (shown.returncode, shown.stderr) == (0, "")
    done = re.findall(r"s  (.*): done", shown.stdout)
    assert done == ["enable", "reference", "move to (1.5, 0.9)", "clean"]
    assert "reallocated: automatic" in shown.stdout
    assert re.search(
        r" ticks were due in .* left out because the next was due, none is missing\n",
        shown.stdout,
    )
    assert (tmp_path / "wall.svg").read_text().count('class="clean"') == 1
    transitions = (tmp_path / "transitions.txt").read_text()
    assert "tool.referencing: off switch to referenced" in transitions
    assert "guide.cleaning: lifting to idle" in transitions
