"""Ctrl-C, or SIGTERM, ends a program of modules at the first time, whatever its handlers wait for."""

import re
import signal
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from integration.programs import central, program

from tca_module import Goal, Outcome, connect
from tca_tools.live.questions import status

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


KILLED = """
from tca_module import Goal, Command, Module, Task, TaskKilled

WORK, NEVER = Goal("work"), Command("nobody handles that")
robot = Module("robot")

@robot.handles(WORK)
def work(task: Task) -> None:
    try:
        print("at work", flush=True)
        task.wait_until_handled(NEVER)
    except TaskKilled as error:
        print(error, flush=True)
        task.wait_until_handled(NEVER)

robot.run()
"""


def test_a_handler_that_waits_on_though_it_was_killed_does_not_keep_its_program(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(KILLED, daemon.address) as robot, connect("user", daemon.address) as user:
        assert robot.stdout
        work = Goal("work")
        working = user.goal(work)
        assert robot.stdout.readline() == "at work\n"
        working.kill("enough")
        killed = f"{working} was killed: enough (by user); the wait for handlers is not waited for any more\n"
        assert robot.stdout.readline() == killed
        waits = (
            r"work \{1\} +until its handler in robot returns, which waits for .* that .*\(killed: enough \(by user\)\)"
        )
        deadline = time.monotonic() + 10
        while not re.search(waits, shown := CliRunner().invoke(status, ["--central", daemon.address]).output):
            assert time.monotonic() < deadline, shown
        robot.send_signal(signal.SIGTERM)
        output, errors = robot.communicate(timeout=20)
        assert working.wait(10) is Outcome.KILLED
    assert (output, errors, robot.returncode) == ("", "", 0)
