"""Tasks that leave navigation to a navigator. Here a module drives the turtle without help of the
tasks.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from turtles.towns import Town, town

from robots.turtle_sim.navigation import MOVE_BASE, MOVE_BASE_SIMPLE, MoveBase, MoveGoal, Target
from robots.turtle_sim.world import Pose
from tca_module import Failure, Module, Outcome, Task, TaskFailed

NO_WAY = Failure("no way")


@contextmanager
def town_with_navigator() -> Iterator[tuple[Town, list[Target]]]:
    """Run a town whose navigator moves the turtle after a second of planning. Places below the x
    axis have no path.
    """
    with town(Pose(5.0, 5.0), tasks=[MoveBase, MoveGoal]) as there:
        told, navigator = list[Target](), Module("navigator", there.central)

        def jump(target: Target) -> None:
            there.world.turtle("turtle").pose = Pose(target.x, target.y, target.yaw)

        @navigator.handles(MOVE_BASE)
        def move_base(task: Task, target: Target) -> None:
            task.sleep(1.0)
            if target.y < 0.0:
                raise NO_WAY(text="below the sheet")
            jump(target)

        @navigator.handles(MOVE_BASE_SIMPLE, resource="simple")
        def move_base_simple(_: Task, target: Target) -> None:
            told.append(target)
            if len(told) > 1:  # the first target is lost
                jump(target)

        with navigator.running():
            yield there, told


def test_move_base_reaches_its_goal() -> None:
    with town_with_navigator() as (there, _):
        there.run("MoveBase", goal_x=2.0, goal_y=3.0, goal_yaw=1.0)
        assert there.pose == Pose(2.0, 3.0, 1.0)


def test_move_base_failure_fails_the_task() -> None:
    with (
        town_with_navigator() as (there, _),
        pytest.raises(TaskFailed, match="below the sheet") as failed,
    ):
        there.run("MoveBase", goal_y=-1.0)
    assert failed.value.failure == "no way"


def test_stopped_task_stops_move_base() -> None:
    with town_with_navigator() as (there, _):
        moving = there.start("MoveBase", goal_x=2.0, goal_y=3.0)
        there.central.advance(0.5)
        moving.kill("enough")
        assert moving.wait(timeout=5) is Outcome.KILLED
        there.central.advance(5.0)
        assert there.place == (5.0, 5.0)


def test_move_goal_is_sent_and_reached() -> None:
    with town_with_navigator() as (there, told):
        moving = there.start("MoveGoal", goal_x=2.0, goal_y=3.0, resend_period=2.0)
        there.central.advance(1.9)
        assert moving.info() is not None
        there.until_over(moving)
        assert told == [Target(2.0, 3.0)] * 2
        assert math.dist(there.place, (2.0, 3.0)) == 0.0


def test_move_goal_may_be_sent_without_waiting() -> None:
    with town_with_navigator() as (there, told):
        there.run("MoveGoal", goal_x=2.0, goal_y=3.0, wait_completion=False)
        assert told == [Target(2.0, 3.0)]
        assert there.place == (5.0, 5.0)
