"""Failures are dealt with by a retry, a kill, or an exception handler that calls resolved()."""

import threading
from collections.abc import Iterator
from typing import Any

import pytest
from module.real_central import SOON, Gate

from tca_module import (
    Client,
    Command,
    ExceptionHandler,
    Failure,
    Goal,
    Module,
    Outcome,
    Recovery,
    Task,
    TaskFailed,
)

DONE, FAILED, RESOLVED = Outcome.DONE, Outcome.FAILED, Outcome.RESOLVED
SLIP = Failure("slip")
WALK, STEP, SWING, MEND = Goal("walk"), Command("step"), Command("swing"), Command("mend")
WEIGH: Command[None, float | None] = Command("weigh", result=float | None)
SLOW: Command[None, float | None] = Command("weigh slowly", result=float | None)
LOOK, TREAT = ExceptionHandler("look"), ExceptionHandler("treat")
ON_SLIP = [Recovery(SLIP, LOOK)]


class Robot:
    """Legs, eyes and an exception handler. ``reactions`` holds its actions, one for each call."""

    def __init__(self, legs: Module, eyes: Module) -> None:
        self.reactions: list[Any] = []
        self.done: list[str] = []
        self.scales = Gate()
        legs.handles(WALK, resource="planner")(self.walk)
        for message in (STEP, WEIGH, SWING, MEND):
            legs.handles(message, resource=message.name)(self.move)
        legs.handles(SLOW, resource="scales")(self.scales)
        eyes.handles(LOOK)(lambda task: self.reactions.pop(0)(task))  # noqa: PLW0108 - one for each call
        eyes.handles(TREAT)(treat)

    def walk(self, task: Task) -> None:
        with task.sequence():
            task.command(STEP)
            task.command(SWING)

    def move(self, task: Task) -> None:
        self.done.append(task.message)
        if task.message in ("step", "weigh"):
            raise SLIP(text="on ice")


@pytest.fixture
def robot(legs: Module, eyes: Module) -> Iterator[Robot]:
    robot = Robot(legs, eyes)
    with legs.running(), eyes.running():
        yield robot
    assert not robot.reactions


async def treat(task: Task) -> None:
    await task.command(MEND)
    task.trouble.resolved()


def observe(_: Task) -> None:
    pass


def resolve(task: Task) -> None:
    assert [task.trouble.resolved(), task.trouble.resolved()] == [True, True]


def kill(task: Task) -> None:
    task.trouble.failing.kill()
    assert not task.trouble.resolved()


def retry(task: Task) -> None:
    task.trouble.failing.retry()
    assert not task.trouble.resolved()


def answer_later(task: Task) -> Any:
    resolve(task)
    later = task.reply_later()
    threading.Timer(0, later.reply).start()
    return later


@pytest.mark.parametrize(
    ("reactions", "outcome"),
    [
        ([resolve], RESOLVED),
        ([answer_later], RESOLVED),
        ([retry, resolve], RESOLVED),
        ([kill], FAILED),
    ],
)
def test_failure_outcome_follows_exception_handler(
    robot: Robot, user: Client, reactions: list[Any], outcome: Any
) -> None:
    robot.reactions = reactions[:]
    assert user.command(STEP, on_failure=ON_SLIP).wait(SOON) is outcome


def test_async_exception_handler_resolves_failure(robot: Robot, user: Client) -> None:
    assert user.command(STEP, on_failure=[Recovery(SLIP, TREAT)]).wait(SOON) is RESOLVED


def test_unresolved_failure_ends_parent_goal(robot: Robot, user: Client) -> None:
    robot.reactions = [observe]
    user.on_failure(None, LOOK)
    with pytest.raises(TaskFailed, match=r"look \{\d+\} returned without dealing with it"):
        user.goal(WALK).result(SOON)
    assert "swing" not in robot.done


def test_resolved_failure_lets_parent_goal_continue(robot: Robot, user: Client) -> None:
    robot.reactions = [resolve, resolve]
    step = user.command(STEP, on_failure=ON_SLIP, suspended=True)
    changes = step.changes(SOON)
    step.resume()
    ends = [
        (change.state, change.transition, change.outcome) for change in changes if change.is_over
    ]
    assert step.result(SOON) is None
    assert ends == [("done", RESOLVED, RESOLVED)]
    assert user.goal(WALK, on_failure=ON_SLIP).wait(SOON) is DONE
    assert robot.done == ["step", "step", "swing"]


def test_declared_result_of_resolved_task_raises(robot: Robot, user: Client) -> None:
    robot.reactions = [resolve]
    with pytest.raises(TaskFailed, match="was resolved") as caught:
        user.command(WEIGH, on_failure=ON_SLIP).result(SOON)
    assert caught.value.failure == "slip"


@pytest.mark.parametrize(("look", "outcome"), [(resolve, RESOLVED), (observe, FAILED)])
def test_external_failure_of_running_task_is_resolved_or_ends_it(
    robot: Robot, user: Client, look: Any, outcome: Any
) -> None:
    looked = threading.Event()
    robot.reactions = [lambda task: [look(task), looked.set()][0]]  # type: ignore[func-returns-value]
    weighed = user.command(SLOW, on_failure=ON_SLIP)
    assert robot.scales.begun.wait(SOON)
    weighed.fail(SLIP())
    assert looked.wait(SOON)
    robot.scales.go_on.set()
    assert weighed.wait(SOON) is outcome
    if outcome is RESOLVED:
        assert weighed.result(SOON) is None  # the handler has returned None
