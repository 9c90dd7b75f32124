"""The simulator as a module on a stepped clock, so that equal commands draw equal lines."""

import pytest

from robots.turtle_sim.messages import CHANGE_PEN, CLEAR_SHEET, POSE, SHEET, VELOCITY, Velocity
from robots.turtle_sim.simulator import Simulator
from robots.turtle_sim.world import Pen, Pose, TurtleWorld
from tca_module import Outcome, connect
from tca_module.testing import LocalCentral


def simulator(*names: str, pace: float = 1.0) -> Simulator:
    world = TurtleWorld()
    for name in names:
        world.spawn(name, Pose(1.0, 1.0))
    return Simulator(world, pace)


def test_turtle_follows_commands_and_reports_its_pose() -> None:
    made = simulator("t")
    with (
        LocalCentral(stepped=True) as central,
        made.module("t", central).running(),
        connect("test", central) as user,
    ):
        user.inform(VELOCITY, Velocity(1.0))
        central.advance(0.5)
        pose = user.get_variable(POSE)
        assert (pose.x, pose.y, pose.linear_velocity) == pytest.approx((1.5, 1.0, 1.0))
        central.advance(2.0)
        assert user.get_variable(POSE).x == pytest.approx(2.0)


def test_simulator_serves_pens_and_the_sheet() -> None:
    made = simulator("t")
    with (
        LocalCentral(stepped=True) as central,
        made.module("t", central).running(),
        connect("test", central) as user,
    ):
        assert user.command(CHANGE_PEN, Pen(255, 0, 0, 4)).wait(timeout=5) is Outcome.DONE
        user.inform(VELOCITY, Velocity(1.0))
        central.advance(1.0)
        sheet = user.query(SHEET)
        assert [(stroke.pen.colour, len(stroke.points)) for stroke in sheet.strokes] == [
            ("#ff0000", 2)
        ]
        assert list(sheet.turtles) == ["t"]
        user.command(CLEAR_SHEET).wait(timeout=5)
        assert user.query(SHEET).strokes == []


def test_turtle_at_rest_sends_nothing() -> None:
    made = simulator("t")
    with LocalCentral(stepped=True) as central, made.module("t", central).running():
        central.advance(1.0)
        said = central.transcript()
        central.advance(10.0)
        assert central.transcript() == said


def test_turtles_of_two_centrals_draw_on_one_sheet() -> None:
    made = simulator("t", "u", pace=2.0)
    with LocalCentral(stepped=True) as one, LocalCentral(stepped=True) as other:
        with made.module("t", one).running(), made.module("u", other).running():
            with connect("test", one) as user:
                user.inform(VELOCITY, Velocity(1.0))
            one.advance(0.25)
            other.advance(5.0)
        assert {name: turtle.pose.x for name, turtle in made.sheet().turtles.items()} == {
            "t": pytest.approx(1.5),
            "u": 1.0,
        }
