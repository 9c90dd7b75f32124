"""The complete demonstration with real processes: central, the turtle's task server, the mission,
the pictures.
"""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from turtles.checkpoints import EXPECTED

from robots.turtle_sim.__main__ import SHOWS
from robots.turtle_sim.missions.three_turtles import MISSIONS
from robots.turtle_sim.sync.team import load_team
from tca_tools.supervise.robot_file import load

ROBOT = Path(__file__).parents[2] / "robots" / "turtle_sim"


def show(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robots.turtle_sim", *arguments, "--out", str(folder)]
    return subprocess.run(command, text=True, capture_output=True, timeout=120, check=False)


@pytest.mark.slow
def test_show_runs_a_mission(tmp_path: Path) -> None:
    shown = show(tmp_path, "background", "--pace", "16")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert re.search(
        r"s  turtle: WaitForROI\(foreground=False, roi_x=1.0, roi_y=6.0, roi_radius=1.0\)\n",
        shown.stdout,
    )
    assert shown.stdout.endswith(f"made {tmp_path / 'sheet.svg'}\nmade {tmp_path / 'sheet.png'}\n")
    assert (tmp_path / "sheet.svg").read_text().count('class="stroke"') == 1
    assert (tmp_path / "sheet.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.soak
@pytest.mark.parametrize(
    "name", [name for name in SHOWS if name not in ("background", "three-turtles")]
)
def test_show_runs_the_other_missions(tmp_path: Path, name: str) -> None:
    shown = show(tmp_path, name)
    assert (shown.returncode, shown.stderr) == (0, "")
    assert 'class="stroke"' in (tmp_path / "sheet.svg").read_text()


@pytest.mark.soak
def test_three_turtles_meet_over_a_link_that_loses_half(tmp_path: Path) -> None:
    shown = show(tmp_path, "three-turtles", "--loss", "0.5", "--pace", "16")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert list(checkpoints(shown.stdout)) == EXPECTED
    logs = "".join((tmp_path / f"{turtle}_task_server.log").read_text() for turtle in MISSIONS)
    assert sum(map(int, re.findall(r"(\d+) of them lost", logs))) > 5


@pytest.mark.soak
def test_three_turtles_run_under_tca_run(tmp_path: Path) -> None:
    """The three turtles run as the page says, in real time."""
    with ExitStack() as stack:
        for turtle in MISSIONS:
            robot = start(
                "tca_tools.supervise",
                str(ROBOT / "sync" / f"{turtle}.toml"),
                log=tmp_path / f"{turtle}.log",
            )
            stack.callback(robot.wait, 60)
            stack.callback(robot.send_signal, signal.SIGINT)
        missions = {
            turtle: start(
                "robots.turtle_sim.missions.three_turtles",
                turtle,
                log=tmp_path / f"mission of {turtle}.log",
                central=f"ipc:///tmp/tca-{turtle}.sock",
            )
            for turtle in MISSIONS
        }
        assert {turtle: mission.wait(180) for turtle, mission in missions.items()} == dict.fromkeys(
            MISSIONS, 0
        )


def start(module: str, *arguments: str, log: Path, central: str = "") -> subprocess.Popen[bytes]:
    environment = {**os.environ, "TCA_CENTRAL": central} if central else None
    with log.open("wb") as file:
        command = [sys.executable, "-m", module, *arguments]
        return subprocess.Popen(command, stdout=file, stderr=file, env=environment)


def checkpoints(said: str) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Yield the departures of turtles to places, and the arrivals that they report, in their common
    order.
    """
    goals = dict[str, tuple[float, float]]()
    for turtle, task, x, y in re.findall(
        r"s  (turtle\d): (\w+)\((?:goal_x=([\d.]+), goal_y=([\d.]+))?", said
    ):
        if task == "GoTo":
            goals[turtle] = float(x), float(y)
            yield "left for", turtle, goals[turtle]
        elif task == "SetStatusSync" and turtle in goals:
            yield "came to", turtle, goals[turtle]


def test_robot_files_of_the_turtles_are_valid() -> None:
    names = {
        path.name: [program.name for program in load(path).programs]
        for path in ROBOT.rglob("turtle*.toml")
    }
    assert names == {
        "turtle.toml": ["central", "simulator", "turtle"],
        **{
            f"turtle{number}.toml": ["central", "simulator", f"turtle{number}"]
            for number in (1, 2, 3)
        },
    }
    assert list(load_team(ROBOT / "sync" / "team.toml")) == ["turtle1", "turtle2", "turtle3"]
