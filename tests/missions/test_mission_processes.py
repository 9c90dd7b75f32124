"""Missions in their own processes, which are killed and resumed."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from missions.rover import TASKS, Rover
from module.real_central import RealCentral, until
from processes import Process, program

from tca_behaviours.missions import Mission, StepUncertain, TaskServer
from tca_module import connect

pytestmark = pytest.mark.slow

SOON = 30.0
TRIP = """
    import signal
    signal.signal(signal.SIGINT, signal.default_int_handler)
    from tca_behaviours.missions import Mission

    with Mission("rover", name="trip", checkpoint="trip.steps", leave_running={stays}) as mission:
        mission.step("out", mission.Drive, x=1.0)
        mission.Watch()
        mission.step("back", mission.Drive, x=2.0, fails="never")
"""


@contextmanager
def running_rover(folder: Path) -> Iterator[tuple[str, Rover]]:
    """Run a central behind a socket, and a rover that serves."""
    with RealCentral(f"ipc://{folder}/central.sock") as central:
        robot = Rover()
        with TaskServer("rover", robot, tasks=TASKS, rate=100.0, central=central.address).running():
            yield central.address, robot


@contextmanager
def mission_process(
    address: str, robot: Rover, folder: Path, *, stays: bool = False
) -> Iterator[Process]:
    """Run the mission in a process. Yield when it drives back, and has recorded both drives in its
    checkpoint.
    """
    process = program(TRIP.format(stays=stays), address, cwd=folder)

    def drives_back() -> bool:
        steps = folder / "trip.steps"
        return (
            "to 2" in robot.done
            and steps.exists()
            and steps.read_bytes().count(b'"is":"task"') >= 2
        )

    try:
        until(lambda: drives_back() or process.poll() is not None, "the rover drives back", SOON)
        yield process
    finally:
        process.close()


def tasks_of(address: str) -> list[str]:
    with connect("user", address) as user:
        return [task.message for task in user.tasks()]


def test_killed_mission_stops_its_tasks_and_resumes_at_its_step(
    tmp_path: Path,
) -> None:
    with running_rover(tmp_path) as (address, robot):
        with mission_process(address, robot, tmp_path) as process:
            process.send_signal(signal.SIGKILL)
            until(lambda: {"stands at 2", "watched"} <= set(robot.done), "the rover is safe", SOON)
        until(lambda: tasks_of(address) == [], "nothing runs", SOON)
        robot.done.clear()
        with Mission(
            "rover", name="trip", central=address, checkpoint=tmp_path / "trip.steps"
        ) as mission:
            assert mission.step("out", mission.Drive, x=1.0).status  # the drive is not repeated
            with pytest.raises(
                StepUncertain,
                match=r"step 'back' was under way .*\(Drive \{\d+\} interrupted: .*module lost",
            ):
                mission.step("back", mission.Drive, x=2.0)
            assert robot.done == []
            mission.repeatable_step("back", mission.Drive, x=2.0)
        assert robot.done == ["to 2", "stands at 2"]
        assert not (tmp_path / "trip.steps").exists()  # a completed mission starts over


def test_resumed_mission_finds_its_running_task_again(tmp_path: Path) -> None:
    with running_rover(tmp_path) as (address, robot):
        with mission_process(address, robot, tmp_path, stays=True) as process:
            process.send_signal(signal.SIGKILL)
            process.wait()
        trip = Mission(
            "rover",
            name="trip",
            central=address,
            checkpoint=tmp_path / "trip.steps",
            leave_running=True,
        )
        with connect("operator", address) as operator, trip as mission:
            (drive,) = [task for task in operator.tasks() if task.message == "rover.Drive"]
            drive.kill("enough", delay=0.1)  # while the mission waits for it
            with pytest.raises(StepUncertain, match=r"Drive \{\d+\} interrupted: enough"):
                mission.step("back", mission.Drive, x=2.0)
        assert robot.done.count("to 2") == 1


def test_ctrl_c_stops_the_tasks_of_a_mission_process(tmp_path: Path) -> None:
    with running_rover(tmp_path) as (address, robot):
        with mission_process(address, robot, tmp_path) as process:
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=SOON)[1] == "mission 'trip' was ended by Ctrl-C\n"
            assert process.returncode == -signal.SIGINT
            assert process.returncode != 0
        assert {"stands at 2", "watched"} <= set(robot.done)
        assert tasks_of(address) == []
