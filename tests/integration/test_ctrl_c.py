"""Ctrl-C ends a program of modules at the first time, whatever its handlers wait for."""

import signal
from pathlib import Path

import pytest
from integration.programs import central, program

pytestmark = pytest.mark.slow

ROBOT = """
import threading, time
from tca_module import Command, Goal, Module, Task

WORK, DOCK, NEVER = Goal("work"), Command("dock"), Command("nobody handles that")
robot = Module("robot")

@robot.handles(WORK)
def work(task: Task) -> None:
    task.command(DOCK)
    task.command(NEVER, sequential=False).wait()

@robot.handles(DOCK, resource="wheels")
def dock(task: Task) -> None:
    print("docking", flush=True)
    while not task.cancelled:
        time.sleep(0.01)
    print("left the dock", flush=True)
"""

RUN = "robot.after(0, lambda callback: callback.goal(WORK))\nrobot.run()\nprint('over', flush=True)\n"
RUNNING = "with robot.running():\n    robot.goal(WORK).wait()\n"


@pytest.mark.parametrize(
    ("body", "code", "said"), [(RUN, 0, "over\n"), (RUNNING, -signal.SIGINT, "")], ids=["run", "running"]
)
def test_the_first_ctrl_c_ends_it(tmp_path: Path, body: str, code: int, said: str) -> None:
    with central(tmp_path) as daemon, program(ROBOT + body, daemon.address) as robot:
        assert robot.stdout
        assert robot.stdout.readline() == "docking\n"
        robot.send_signal(signal.SIGINT)
        output, errors = robot.communicate(timeout=20)
    assert output == f"left the dock\n{said}"
    assert robot.returncode == code
    assert errors.strip().endswith("KeyboardInterrupt" if code else "")
