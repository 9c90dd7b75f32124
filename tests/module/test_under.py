"""Monitors, goals and commands that are put under a task which others handle."""

import threading
from collections.abc import Iterator

import pytest

from tca_module import (
    Client,
    Command,
    Goal,
    Module,
    Outcome,
    PollingMonitor,
    Query,
    SentTask,
    Task,
    connect,
)
from tca_module.testing import LocalCentral

SOON = 5.0
WALK, STEP, GUARD = Goal("walk"), Command("step", int), Command("guard")
IS_LOW, STOP = Query("is the battery low", reply=bool), Command("stop")
BATTERY = PollingMonitor("battery", condition=IS_LOW, action=STOP)


class Robot:
    """A planner whose walk waits to be told to go on; steps; and a watcher that knows of both."""

    def __init__(self, central: LocalCentral) -> None:
        self.central = central
        self.steps: list[int] = []
        self.asked, self.is_low, self.begun, self.go_on = (threading.Event() for _ in range(4))
        self.planner, self.legs, self.watcher = (Module(name, central) for name in ("planner", "legs", "watcher"))
        self.planner.handles(WALK)(self.walk)
        self.planner.handles(GUARD)(self.guard)
        self.legs.handles(STEP)(lambda _, number: self.steps.append(number))
        self.watcher.handles(IS_LOW)(self.answer)
        self.watcher.handles(STOP)(self.stop)

    def walk(self, task: Task) -> None:
        task.command(STEP, 1)
        self.guard(task)
        task.command(STEP, 3)

    def guard(self, _: Task) -> None:
        self.begun.set()
        assert self.go_on.wait(SOON)

    def answer(self, _: Task) -> bool:
        self.asked.set()
        return self.is_low.is_set()

    def stop(self, task: Task) -> None:
        task.monitor_ref.ancestors(WALK)[0].kill("the battery is low")
        self.go_on.set()

    def begin(self, message: Goal[None] | Command[None, None], user: Client) -> SentTask[None]:
        sent: SentTask[None] = user.execute(message)
        assert self.begun.wait(SOON)
        return sent


@pytest.fixture
def robot() -> Iterator[Robot]:
    with LocalCentral(check=True) as central:
        robot = Robot(central)
        with robot.planner.running(), robot.legs.running(), robot.watcher.running():
            yield robot
            robot.go_on.set()


@pytest.fixture
def user(robot: Robot) -> Iterator[Client]:
    with connect("user", robot.central) as client:
        yield client


def test_a_monitor_is_put_under_a_task_that_runs_and_finds_it(robot: Robot, user: Client) -> None:
    walking = robot.begin(WALK, user)
    monitor = robot.watcher.under(robot.watcher.tasks(WALK)[0]).monitor(BATTERY, period=0.01)
    assert monitor.parent() is not None
    robot.is_low.set()
    assert walking.wait(SOON) is Outcome.KILLED
    assert monitor.wait(SOON) is Outcome.KILLED


def test_a_command_stands_in_the_sequence_that_others_send(robot: Robot, user: Client) -> None:
    walking = robot.begin(WALK, user)
    user.under(walking).command(STEP, 2)
    robot.go_on.set()
    assert walking.wait(SOON) is Outcome.DONE
    assert robot.steps == [1, 2, 3]


def test_blocks_under_a_task_of_others(robot: Robot, user: Client) -> None:
    sent = robot.begin(GUARD, user)
    under = user.under(sent)
    with under.sequence():
        first = under.command(STEP, 1)
        user.under(sent).command(STEP, 7, sequential=False)
        second = under.command(STEP, 2)
    robot.go_on.set()
    assert second.wait(SOON) is first.wait(SOON) is sent.wait(SOON) is Outcome.DONE
    assert sorted(robot.steps) == [1, 2, 7]
    assert robot.steps.index(1) < robot.steps.index(2)
