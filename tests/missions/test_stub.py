"""The stub file for editors and type checkers. A program that uses it passes mypy, and runs."""

import subprocess
import sys
from pathlib import Path

import pytest
from missions.rover import mission_of_rover

from tca_behaviours.missions.client.stub import class_name, stub_text

ROOT = Path(__file__).parents[2]

GOOD = """
from rover_tasks import RoverMission
from tca_behaviours.missions import ConditionIsCompleted, TaskEnd, TaskHandle

with RoverMission() as mission:
    end: TaskEnd = mission.Drive(x=1.0, gear="fast")
    watch: TaskHandle = mission.Watch()
    waited: TaskEnd = mission.Watch(foreground=True)
    weighed: TaskEnd = mission.step("weigh", mission.Weigh, grams=[1, 2])
    mission.add_condition(ConditionIsCompleted(watch))
    mission.wait_for_all_tasks([watch, mission.Drive(foreground=False)])
"""
BAD = """
from rover_tasks import RoverMission

def fly(mission: RoverMission) -> None:
    mission.Fly()
    mission.Drive(y=1.0)
    mission.Drive(x="far")
    mission.Drive(gear="top")
    mission.Weigh()
    mission.wait_for_task(mission.Drive())
"""


@pytest.mark.soak
@pytest.mark.slow
def test_mypy_accepts_correct_and_rejects_wrong_stub_use(
    tmp_path: Path,
) -> None:
    with mission_of_rover() as (mission, _):
        (tmp_path / "rover_tasks.py").write_text(
            stub_text(mission.server, mission.offered().values())
        )
    (tmp_path / "good.py").write_text(GOOD)
    (tmp_path / "bad.py").write_text(BAD)
    files = [str(tmp_path / name) for name in ("rover_tasks.py", "good.py", "bad.py")]
    found = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", "setup.cfg", "--no-error-summary", *files],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    errors = [line.split(":") for line in found.stdout.splitlines() if ": error: " in line]
    wrong = {(Path(file).name, int(number)) for file, number, *_ in errors}
    assert wrong == {("bad.py", number) for number in range(5, 11)}, found.stdout + found.stderr


@pytest.mark.parametrize(
    ("server", "name"),
    [
        ("turtle", "TurtleMission"),
        ("turtle 1", "Turtle1Mission"),
        ("2 arms", "ArmsMission"),
        ("left-arm", "LeftArmMission"),
    ],
)
def test_stub_class_is_named_after_the_server(server: str, name: str) -> None:
    assert class_name(server) == name
