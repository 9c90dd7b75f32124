"""What a type checker infers from the declarations. These tests pass by being checked, not by being run."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import assert_type

import pytest
from module.gait_messages import REST, STANCE, TEMPERATURE

from tca_module import Module, Task

MISTAKES = """
from module.gait_messages import ALARM, COLLISION, HEALTH, MOVE_LEG, REST, STANCE, TEMPERATURE, WALK, Arc, Footfall
from tca_module import LaterReply, Module, Task
legs = Module("legs")
def f(task: Task) -> None:
    task.query(REST)
    task.goal(MOVE_LEG, 1)
    task.inform(ALARM, "x")
    task.goal(WALK, 5)
    task.goal(REST, sequentially=True)
    height: int = task.command(MOVE_LEG, 1).result()
    raise COLLISION(5)
@legs.handles(STANCE)
def g(task: Task, radius: str) -> list[int]: ...
@legs.handles(STANCE)
def h(task: Task, radius: float) -> int: ...
@legs.handles(STANCE)
def i(task: Task) -> list[int]: ...
@legs.handles(TEMPERATURE)
def j(task: Task) -> str: ...
@legs.handles(STANCE)
async def k(task: Task, radius: float) -> int: ...
@legs.handles(STANCE)
def l(task: Task, radius: float) -> LaterReply[int]: ...
async def m(task: Task) -> int:
    return await task.query_send(STANCE, 1.0)
def n(task: Task, later: LaterReply[Footfall]) -> None:
    later.reply(1)
    task.query_notify(TEMPERATURE, None, lambda sender, degrees: degrees.upper())
    legs.after("soon", print)
    legs.every(1.0)(f)
    for health in task.multi_query_send(HEALTH): health.real
"""


def handlers(module: Module) -> None:
    @module.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        return [1]

    @module.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        return 0.0

    @module.handles(REST)
    def rest(task: Task, _nothing: None) -> None:
        return None

    assert_type(stance(Task.__new__(Task), 1.0), list[int])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("mypy", path=str(Path(sys.executable).parent)) is None, reason="mypy is not installed")
def test_mistakes_are_found_by_the_type_checker() -> None:
    root = Path(__file__).parents[2]
    found = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", "setup.cfg", "-c", MISTAKES],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    wrong = {int(line.split(":")[1]) for line in found.stdout.splitlines() if ": error:" in line}
    # The line of each mistake; of a handler, its decorator.
    handlers = {13, 15, 17, 19, 21, 23}
    assert wrong - {line + 1 for line in handlers} == {6, 7, 8, 9, 10, 11, 12, *handlers, 26, 28, 29, 30, 31, 32}, (
        found.stdout
    )
