"""The whole thing, with real processes: central, the turtle's task server, the mission, the pictures."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from turtles.checkpoints import EXPECTED

from robots.turtle_sim.__main__ import SHOWS
from robots.turtle_sim.missions.three_turtles import MISSIONS
from robots.turtle_sim.sync.team import load_team
from tca_run.robot_file import load
from tca_tools.run.journals import open_log
from tca_wire.journal import facts

ROBOT = Path(__file__).parents[2] / "robots" / "turtle_sim"


def show(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robots.turtle_sim", *arguments, "--out", str(folder)]
    return subprocess.run(command, text=True, capture_output=True, timeout=120, check=False)


@pytest.mark.slow
def test_a_mission_is_shown(tmp_path: Path) -> None:
    shown = show(tmp_path, "background", "--pace", "16")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert shown.stdout.splitlines()[1:] == [str(tmp_path / "sheet.svg"), str(tmp_path / "sheet.png")]
    assert (tmp_path / "sheet.svg").read_text().count('class="stroke"') == 1
    assert (tmp_path / "sheet.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.soak
@pytest.mark.parametrize("name", [name for name in SHOWS if name not in ("background", "three-turtles")])
def test_so_are_the_others(tmp_path: Path, name: str) -> None:
    shown = show(tmp_path, name)
    assert (shown.returncode, shown.stderr) == (0, "")
    assert 'class="stroke"' in (tmp_path / "sheet.svg").read_text()


@pytest.mark.slow
def test_three_turtles_over_a_link_that_loses_half(tmp_path: Path) -> None:
    shown = show(tmp_path, "three-turtles", "--loss", "0.5", "--pace", "16")
    assert (shown.returncode, shown.stderr) == (0, "")
    happened = [event for turtle in MISSIONS for event in checkpoints(turtle, tmp_path / f"{turtle} journal")]
    assert [event for _, event in sorted(happened)] == EXPECTED
    logs = "".join((tmp_path / f"{turtle}_task_server.log").read_text() for turtle in MISSIONS)
    assert sum(map(int, re.findall(r"(\d+) of them lost", logs))) > 5


def checkpoints(turtle: str, journal: Path) -> Iterator[tuple[float, tuple[str, str, tuple[float, float]]]]:
    """When a turtle left for a place, and when it had come there, in seconds since 1970."""
    began, goals = 0.0, dict[int, tuple[float, float]]()
    for entry in open_log(journal):
        for fact in entry.facts:
            if isinstance(fact, facts.Opened):
                began = fact.began
            elif isinstance(fact, facts.Received) and fact.message == f"{turtle}.GoTo":
                goal = msgspec.msgpack.decode(fact.body)
                goals[fact.id] = goal["goal_x"], goal["goal_y"]
                yield began + entry.time, ("left for", turtle, goals[fact.id])
            elif isinstance(fact, facts.Returned) and fact.id in goals:
                yield began + entry.time, ("came to", turtle, goals[fact.id])


def test_the_robots_files() -> None:
    names = {path.name: [program.name for program in load(path).programs] for path in ROBOT.rglob("turtle*.toml")}
    assert names == {
        "turtle.toml": ["central", "simulator", "turtle"],
        **{f"turtle{number}.toml": ["central", "simulator", f"turtle{number}"] for number in (1, 2, 3)},
    }
    assert list(load_team(ROBOT / "sync" / "team.toml")) == ["turtle1", "turtle2", "turtle3"]
