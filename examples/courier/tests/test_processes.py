"""The robot as it runs: five processes and a central."""

import threading
import time
from pathlib import Path

from courier.messages import DELIVER, DRIVE, Parcel, Trip

from tca_module import Outcome, connect
from tca_tools.testing.daemon import DaemonOfTest

ROBOT = Path(__file__).parents[1] / "robot.toml"
PARCEL = Parcel("book", Trip("kitchen", "store"))


def test_robot_delivers_a_parcel(tca_daemon: DaemonOfTest) -> None:
    tca_daemon.start_robot(ROBOT)
    with connect("test") as user:
        user.wait_until_handled(DELIVER, timeout=30)
        assert user.goal(DELIVER, PARCEL).wait(timeout=30) is Outcome.DONE


def test_delivery_survives_a_restart_of_the_arm(tca_daemon: DaemonOfTest) -> None:
    arm_is_back = threading.Event()
    drive = tca_daemon.fake(DRIVE, returns=lambda _task, _room: float(arm_is_back.wait(30)))
    tca_daemon.start_robot(ROBOT, leave_out=["wheels"])
    with connect("test") as user:
        user.wait_until_handled(DELIVER, timeout=30)
        delivery = user.goal(DELIVER, PARCEL)
        drive.wait_for_calls(1, timeout=30)
        new_arm = tca_daemon.programs.kill_and_restart("arm")
        while not any(one.process.endswith(f":{new_arm}") for one in user.modules()):
            time.sleep(0.02)  # until central knows that the old arm is gone
        arm_is_back.set()
        assert delivery.wait(timeout=30) is Outcome.DONE
    assert drive.calls == ["kitchen", "store"]


def test_drive_survives_a_restart_of_central(tca_daemon: DaemonOfTest) -> None:
    central_is_back = threading.Event()
    drive = tca_daemon.fake(DRIVE, returns=lambda _task, _room: float(central_is_back.wait(30)))
    with connect("test") as user:
        driven = user.command(DRIVE, "store")
        drive.wait_for_calls(1, timeout=30)
        tca_daemon.programs.kill_and_restart("central")
        central_is_back.set()
        assert driven.wait(timeout=30) is Outcome.DONE
