"""Kills and locks take effect at once, even under heavy load."""

import math
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from processes import central, program

from tca_module import Command, Outcome, connect

FLOOD = """
from tca_module import Goal, Inform, connect
with connect("flood") as user:
    print("floods", flush=True)
    while True:
        for _ in range(50):
            user.inform(Inform("note", bytes), b"x" * 1000)
        user.goal(Goal("nobody handles that"))
"""
WORKS = """
import time
from tca_module import Command, Inform, Module, Task
arm = Module("arm")
arm.handles(Inform("note", bytes), resource="slow")(lambda task, note: time.sleep(0.01))

@arm.handles(Command("work"))
def work(task: Task) -> None:
    while not task.cancelled:
        time.sleep(0.001)

arm.run()
"""
WORK, SOON, AT_ONCE = Command("work"), 30.0, 2.0
KILLS = 100


@pytest.mark.soak
def test_kills_and_locks_are_quick_under_flood(tmp_path: Path) -> None:
    with (
        central(tmp_path) as daemon,
        ExitStack() as programs,
        connect("user", daemon.address) as user,
    ):
        programs.enter_context(program(WORKS, daemon.address))
        user.wait_until_handled(WORK, timeout=SOON)
        for _ in range(3):
            flood = programs.enter_context(program(FLOOD, daemon.address))
            flood.hear("floods")
        took = []
        for _ in range(KILLS):
            work = user.command(WORK, sequential=False)
            began = time.monotonic()
            work.kill("stop")
            assert work.wait(timeout=SOON) is Outcome.KILLED
            user.lock("arm", timeout=SOON).release()
            took.append(time.monotonic() - began)
        assert sorted(took)[math.ceil(0.99 * KILLS) - 1] < AT_ONCE, took
