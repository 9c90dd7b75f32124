"""The turtle's tasks, one at a time."""

import math

import pytest
from turtles.towns import town

from robots.turtle_sim.environment import TurtleEnvironment
from robots.turtle_sim.task_server import TASKS
from robots.turtle_sim.world import Pen, Pose
from tca_behaviours.missions import Mission, MissionTaskFailed, Status, TaskServer
from tca_module import Outcome, TaskKilled
from tca_module.testing import LocalCentral

COMPLETED = Status.COMPLETED | Status.TERMINATED


def test_go_to_stops_at_its_goal() -> None:
    with town() as there:
        assert there.run("GoTo", goal_x=1.0, goal_y=1.0).status == COMPLETED
        there.central.advance(0.1)
        assert math.dist(there.place, (1.0, 1.0)) < 0.11
        assert (there.pose.linear_velocity, there.pose.angular_velocity) == (0.0, 0.0)


def test_go_to_turns_before_it_drives() -> None:
    with town(Pose(5.0, 5.0, theta=math.pi)) as there:
        going = there.start("GoTo", goal_x=9.0, goal_y=5.0)
        there.central.advance(2.0)
        assert there.place == (5.0, 5.0)
        there.until_over(going)
        assert math.dist(there.place, (9.0, 5.0)) < 0.11


def test_stopped_go_to_stands_still() -> None:
    with town() as there:
        going = there.start("GoTo", goal_x=9.0, goal_y=5.5)
        there.central.advance(1.0)
        assert there.pose.linear_velocity == 1.0
        going.kill("enough")
        there.until_over(going)
        there.central.advance(0.1)
        assert there.pose.linear_velocity == 0.0
        with pytest.raises(TaskKilled, match="enough"):
            going.result(timeout=5)


def test_running_go_to_accepts_a_new_goal_and_speed() -> None:
    with town() as there:
        going = there.start("GoTo", goal_x=9.0, goal_y=5.5)
        there.central.advance(1.0)
        going.update_send(
            there.server.definitions["GoTo"].parameters(goal_x=6.5, goal_y=8.5, max_velocity=0.5)
        )
        there.central.advance(4.0)  # it turns on the spot first
        assert there.pose.linear_velocity == 0.5
        there.until_over(going)
        assert math.dist(there.place, (6.5, 8.5)) < 0.11


def test_wait_task_lasts_its_duration() -> None:
    with town() as there:
        waiting = there.start("Wait", duration=2.0)
        there.central.advance(1.9)
        assert waiting.info() is not None
        there.central.advance(0.2)
        assert waiting.wait(timeout=5) is Outcome.DONE


def test_wait_for_roi_ends_when_the_turtle_enters_it() -> None:
    with town() as there:
        watch = there.start("WaitForROI", foreground=False, roi_x=9.0, roi_y=5.5, roi_radius=1.0)
        there.central.advance(1.0)
        assert watch.info() is not None
        there.run("GoTo", goal_x=9.0, goal_y=5.5)
        assert watch.wait(timeout=5) is Outcome.DONE


def test_set_pen_and_constant_velocity_draw_a_circle() -> None:
    with town(Pose(5.0, 4.0)) as there:
        there.run("SetPen", r=200, g=60, b=40, width=5)
        there.run("Constant", linear=1.0, angular=1.0, duration=6.3)
        (stroke,) = there.world.strokes
        assert stroke.pen == Pen(200, 60, 40, 5)
        assert max(y for _, y in stroke.points) == pytest.approx(6.0, abs=0.01)
        assert math.dist(there.place, (5.0, 4.0)) < 0.2
        there.run("SetPen", on=False)
        there.run("Constant", linear=1.0, duration=1.0)
        assert there.world.strokes == [stroke]


def test_rotate_accepts_more_than_a_full_turn() -> None:
    with town(Pose(5.0, 5.0, theta=1.0)) as there:
        there.run("Rotate", angle=-8.0, velocity=2.0)
        assert math.remainder(there.pose.theta - (1.0 - 8.0), math.tau) == pytest.approx(
            0.0, abs=0.03
        )
        assert there.place == (5.0, 5.0)


def test_clear_accepts_a_structured_argument() -> None:
    with town() as there:
        there.run("Constant", linear=1.0, duration=1.0)
        assert there.world.strokes
        assert (
            there.run("Clear", header={"frame_id": "Hello"}).text
            == "got an extra header, frame_id=Hello"
        )
        assert there.world.strokes == []
        assert there.run("Clear").text == ""


def test_turtle_tasks_say_that_the_simulator_is_missing() -> None:
    with LocalCentral() as central:
        server = TaskServer(
            "turtle", TurtleEnvironment(patience=0.0), folder=TASKS, central=central
        )
        with server.running(), Mission("turtle", central=central) as mission:
            with pytest.raises(
                MissionTaskFailed,
                match="the turtle has not sent its pose: does its simulator run",
            ):
                mission.GoTo()
