"""What a type checker infers from the declarations. These tests pass by being checked, not by being run."""

import asyncio
import shutil
import subprocess
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, assert_type

import pytest
from module.gait_messages import (
    ALARM,
    COLLISION,
    HEALTH,
    MOVE_LEG,
    REST,
    STANCE,
    STOP,
    TEMPERATURE,
    WALK,
    Arc,
    Footfall,
)

from tca_module import (
    Callback,
    Client,
    Constraint,
    LaterReply,
    Module,
    Outcome,
    PendingReplies,
    PendingReply,
    SentTask,
    Task,
    TaskFailed,
    Variable,
)

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


def replies(task: Task, module: Module, client: Client) -> None:
    for sender in (task, module, client):
        assert_type(sender.query(STANCE, 1.0), list[int])
        assert_type(sender.query_send(TEMPERATURE), PendingReply[float])
        assert_type(sender.query_send(TEMPERATURE).receive(), float)
        assert_type(sender.multi_query(HEALTH), list[str])
        assert_type(sender.command(MOVE_LEG, 1), SentTask[Footfall])
        assert_type(sender.command(MOVE_LEG, 1).result(), Footfall)
        assert_type(sender.command(STOP), SentTask[None])
        assert_type(sender.goal(WALK, Arc(1.0, 2), plan_first=True), SentTask[None])
        assert_type(sender.goal(REST).wait(), Outcome)


def whatever_the_class(task: Task) -> None:
    assert_type(task.execute(REST), SentTask[None])
    assert_type(task.execute(MOVE_LEG, 1), SentTask[Footfall])
    assert_type(task.execute(STANCE, 1.0), list[int])
    assert_type(task.execute(HEALTH), list[str])
    assert_type(task.execute_if_handled(MOVE_LEG, 1), SentTask[Footfall] | None)
    assert_type(task.execute_if_handled(TEMPERATURE), float | None)
    assert_type(task.execute_if_handled(ALARM, "stop"), bool)


def variables(task: Task) -> None:
    speed = Variable("speed", float)
    assert_type(task.get_variable(speed), float)
    assert_type(task.get_variable(speed, None), float | None)
    assert_type(task.swap_variable(speed, 1.0), float | None)
    assert_type(task.swap_variable(speed, 1.0, 0.0), float)


def points(task: Task, leg: SentTask[Footfall]) -> list[Constraint]:
    return [leg.achieving.end <= task.planning.start, task.handling.end >= leg.handling.start]


def failures(error: TaskFailed) -> None:
    assert_type(error.data_as(COLLISION), Footfall)


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


def other_handlers(module: Module) -> None:
    @module.handles(STANCE)
    async def stance(task: Task, radius: float) -> list[int]:
        assert_type(await task.query_send(TEMPERATURE), float)
        assert_type(await task.command(MOVE_LEG, 1), Footfall)
        assert_type(await asyncio.gather(task.query_send(STANCE, 1.0), task.goal(REST)), tuple[list[int], None])
        return [1]

    @module.handles(MOVE_LEG)
    def move_leg(task: Task, leg: int) -> Footfall | LaterReply[Footfall]:
        later: LaterReply[Footfall] = task.reply_later()
        return later

    @module.handles(TEMPERATURE)
    async def temperature(task: Task) -> LaterReply[float]:
        return task.reply_later()

    _: Callable[[Task, float], Coroutine[Any, Any, list[int]]] = stance


def callbacks(module: Module, task: Task) -> None:
    @module.every(0.5)
    def beat() -> int:
        return 1

    @module.every(0.5, resource="arm")
    def other_beat(callback: Callback) -> None:
        callback.cancel()

    assert_type(beat(), int)
    assert_type(module.after(1.0, other_beat), Callback)
    module.on_readable(0, lambda callback: callback.cancel())
    module.on_readable(0, lambda: None)
    assert_type(task.multi_query_send(HEALTH), PendingReplies[str])
    task.query_notify(TEMPERATURE, None, lambda sender, degrees: sender.command(MOVE_LEG, round(degrees)))


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
