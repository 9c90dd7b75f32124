"""Declarations as a type checker sees them, and mistakes that the checker finds. mypy reads this
file for test_types.py. The file is never run.
"""

from dataclasses import dataclass
from typing import Any, assert_type

from tca_module import (
    Broadcast,
    Change,
    Command,
    DemonMonitor,
    Failure,
    Goal,
    LaterReply,
    Module,
    MultiQuery,
    Query,
    Server,
    Task,
    TaskRequest,
)


@dataclass
class Footfall:
    leg: int


WALK = Goal("walk", Footfall)
REST = Goal("rest")
MOVE_LEG = Command("move leg", int, result=Footfall)
STANCE = Query("stance", float, reply=list[int])
TEMPERATURE = Query("temperature", reply=float)
LEVEL: Query[float | None, float] = Query("level", float | None, reply=float)
HEALTH = MultiQuery("health", reply=str)
ALARM = Broadcast("alarm", str)
COLLISION = Failure("collision", Footfall)
ROCKS = DemonMonitor("rocks", float)


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


def wrong_handlers(module: Module) -> None:
    @module.handles(STANCE)  # type: ignore[arg-type]
    def wrong_data(task: Task, radius: str) -> list[int]:
        return []

    @module.handles(STANCE)  # type: ignore[arg-type]
    def wrong_reply(task: Task, radius: float) -> int:
        return 1

    @module.handles(STANCE)  # type: ignore[arg-type]
    def without_data(task: Task) -> list[int]:
        return []

    @module.handles(TEMPERATURE)  # type: ignore[arg-type]
    def wrong_reply_without_data(task: Task) -> str:
        return ""

    @module.handles(STANCE)  # type: ignore[arg-type]
    async def wrong_reply_of_a_coroutine(task: Task, radius: float) -> int:
        return 1

    @module.handles(STANCE)  # type: ignore[arg-type]
    def wrong_later_reply(task: Task, radius: float) -> LaterReply[int]:
        return task.reply_later()


def wrong_calls(module: Module, task: Task, later: LaterReply[Footfall]) -> None:
    task.query(REST)  # type: ignore[call-overload]
    task.goal(MOVE_LEG, 1)  # type: ignore[call-overload]
    task.inform(ALARM, "x")  # type: ignore[call-overload]
    task.goal(WALK, 5)  # type: ignore[misc]
    task.goal(REST, sequentially=True)  # type: ignore[call-overload]
    height: int = task.command(MOVE_LEG, 1).result()  # type: ignore[assignment]
    later.reply(1)  # type: ignore[arg-type]
    task.query_notify(TEMPERATURE, None, lambda _, degrees: degrees.upper())  # type: ignore[attr-defined]
    module.after("soon", print)  # type: ignore[arg-type]
    module.every(1.0)(wrong_handlers)  # type: ignore[type-var]
    for health in task.multi_query_send(HEALTH):
        _ = health.real, height  # type: ignore[attr-defined]
    raise COLLISION(5)  # type: ignore[arg-type]


def sent_without_data(task: Task, later: LaterReply[Footfall]) -> None:
    task.goal(WALK)  # type: ignore[arg-type]
    task.command(MOVE_LEG)  # type: ignore[arg-type]
    task.command(MOVE_LEG, priority=5)  # type: ignore[arg-type]
    task.query(STANCE)  # type: ignore[arg-type]
    task.query_send(STANCE)  # type: ignore[arg-type]
    task.broadcast(ALARM)  # type: ignore[arg-type]
    task.execute(WALK)  # type: ignore[arg-type]
    task.execute_if_handled(MOVE_LEG)  # type: ignore[arg-type]
    task.on_termination(WALK)  # type: ignore[arg-type]
    task.monitor(ROCKS)  # type: ignore[arg-type]
    task.retry(WALK)  # type: ignore[arg-type]
    later.reply()  # type: ignore[call-arg]
    _ = COLLISION()  # type: ignore[call-arg]


def sent_with_what_is_wanted(
    task: Task, later: LaterReply[None], any_message: Command[Any, Any]
) -> None:
    assert_type(task.command(MOVE_LEG, 1, priority=5).result(), Footfall)
    assert_type(task.query(TEMPERATURE), float)
    assert_type(task.execute(STANCE, 1.0), list[int])
    task.goal(REST)
    task.goal(REST, None, deadline=2.0)
    task.command(any_message)
    task.command(any_message, 5)
    task.query(LEVEL, None)
    later.reply()
    task.retry()


async def wrong_await(task: Task) -> int:
    return await task.query_send(STANCE, 1.0)  # type: ignore[arg-type]


# --- Following, requests, servers -----------------------------------------------------------------


class Stepping(Server[int, Footfall]):
    def initiated(self, task: Task, goal: int) -> Footfall:
        request = task.wait_for_request()
        assert_type(request.accept(), bool)
        assert_type(task.wait_for_request(1.0), TaskRequest | None)
        return Footfall(goal)

    def update(self, task: Task, goal: int) -> bool:
        return goal > 0


class AsyncStepping(Server[int, Footfall]):
    async def initiated(self, task: Task, goal: int) -> Footfall:
        async for request in task.requests():
            assert_type(request, TaskRequest)
        return Footfall(goal)


class WrongStepping(Server[int, Footfall]):
    def initiated(self, task: Task, goal: int) -> int:  # type: ignore[override]
        return goal


def followed(task: Task, module: Module) -> None:
    move = task.command(MOVE_LEG, 1)
    assert_type(move.state, str)
    assert_type(next(move.progress(float)), float)
    assert_type(move.next_change(), Change | None)
    assert_type(move.update_send(2).wait(), None)
    for change in move.changes():
        assert_type(change.task.state, str)
    assert_type(task.observe(MOVE_LEG).arrived(), list[Change])
    module.serve(MOVE_LEG, Stepping(), when_busy="preempt")
    module.serve(MOVE_LEG, AsyncStepping())
    module.serve(WALK, Stepping())  # type: ignore[misc]
    module.handles(MOVE_LEG, when_busy="later")  # type: ignore[call-overload]
    module.observes(WALK)(wrong_handlers)  # type: ignore[type-var]
    move.on_change(lambda change: change.stat)  # type: ignore[attr-defined]
