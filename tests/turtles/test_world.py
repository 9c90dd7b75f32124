"""The turtles' world: arcs, walls, pens, and time that only the test advances."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.turtle_sim.drawing import draw
from robots.turtle_sim.errors import NoSuchTurtle, TurtleExists
from robots.turtle_sim.simulator import Simulator
from robots.turtle_sim.world import COMMAND_LIFE, SIZE, Pen, Pose, TurtleWorld


def world(x: float = 5.0, y: float = 5.0) -> TurtleWorld:
    made = TurtleWorld()
    made.spawn("t", Pose(x, y))
    return made


def ends(made: TurtleWorld) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return [(stroke.points[0], stroke.points[-1]) for stroke in made.strokes]


def test_turtle_draws_a_line_of_two_points() -> None:
    made = world()
    made.command("t", 2.0, 0.0)
    made.advance(1.0)
    assert made.turtle("t").pose.x == pytest.approx(7.0)
    (stroke,) = made.strokes
    assert stroke.points == [(5.0, 5.0), (pytest.approx(7.0), 5.0)]


def test_turtle_draws_nothing_when_it_turns() -> None:
    made = world()
    made.command("t", 0.0, math.pi / 2)
    made.advance(1.0)
    assert made.turtle("t").pose.theta == pytest.approx(math.pi / 2)
    assert made.strokes == []


def test_circle_ends_where_it_started() -> None:
    made = world()
    for _ in range(8):
        made.command("t", 1.0, math.tau / 8)
        made.advance(1.0)
    pose = made.turtle("t").pose
    assert (pose.x, pose.y, pose.theta) == pytest.approx((5.0, 5.0, 0.0), abs=1e-9)
    assert max(y for _, y in made.strokes[0].points) == pytest.approx(
        5.0 + 2 * 8 / math.tau, abs=1e-3
    )


def test_turtle_stops_without_commands() -> None:
    made = world()
    made.command("t", 1.0, 0.1)
    made.advance(5.0)
    pose = made.turtle("t").pose
    assert math.hypot(pose.x - 5.0, pose.y - 5.0) == pytest.approx(COMMAND_LIFE, rel=0.01)
    assert (pose.linear_velocity, pose.angular_velocity) == (0.0, 0.0)


def test_walls_stop_a_turtle() -> None:
    made = world(10.5, 5.0)
    made.command("t", 1.0, 0.0)
    made.advance(1.0)
    assert made.turtle("t").pose.x == SIZE
    assert ends(made) == [((10.5, 5.0), (SIZE, 5.0))]


def test_turtle_is_placed_inside_the_sheet() -> None:
    pose = world(-3.0, 40.0).turtle("t").pose
    assert (pose.x, pose.y) == (0.0, SIZE)


def test_each_pen_draws_its_strokes_and_a_raised_pen_none() -> None:
    made = world(1.0, 1.0)
    red = Pen(255, 0, 0, width=5)
    for pen in (Pen(), red, Pen(is_down=False), red):
        made.set_pen("t", pen)
        made.command("t", 1.0, 0.0)
        made.advance(1.0)
    assert [stroke.pen for stroke in made.strokes] == [Pen(), red, red]
    assert [round(start[0]) for start, _ in ends(made)] == [1, 2, 4]
    assert red.colour == "#ff0000"


def test_clear_wipes_the_sheet_and_the_next_line_starts_here() -> None:
    made = world()
    made.command("t", 1.0, 0.0)
    made.advance(0.5)
    made.clear()
    assert made.strokes == []
    made.advance(0.5)
    assert ends(made) == [((5.5, 5.0), (6.0, 5.0))]


@given(st.lists(st.floats(0.0, 0.5), max_size=40), st.floats(-2, 2), st.floats(-3, 3))
def test_lines_do_not_depend_on_the_time_step(
    pieces: list[float], linear: float, angular: float
) -> None:
    whole, slices = world(), world()
    for made in (whole, slices):
        made.command("t", linear, angular)
    for piece in pieces:
        slices.advance(piece)
    whole.advance(slices.turtle("t").time)
    assert whole.turtle("t").pose == slices.turtle("t").pose
    assert [stroke.points for stroke in whole.strokes] == [
        stroke.points for stroke in slices.strokes
    ]


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=20))
def test_no_command_moves_a_turtle_off_the_sheet(commands: list[tuple[float, float]]) -> None:
    made = world()
    for linear, angular in commands:
        made.command("t", linear, angular)
        made.advance(0.1)
        pose = made.turtle("t").pose
        assert 0.0 <= pose.x <= SIZE
        assert 0.0 <= pose.y <= SIZE
        assert -math.pi <= pose.theta <= math.pi


def test_world_errors_name_what_exists() -> None:
    made = world()
    with pytest.raises(NoSuchTurtle, match="there is no turtle 'u': the turtles are t"):
        made.command("u", 1.0, 0.0)
    with pytest.raises(TurtleExists, match="already a turtle 't'"):
        made.spawn("t")


def test_picture_has_each_stroke_and_each_turtle() -> None:
    made = world(1.0, 1.0)
    made.spawn("<u>", Pose(9.0, 10.8))
    made.set_pen("t", Pen(1, 2, 255, width=7))
    made.command("t", 1.0, 0.0)
    made.advance(1.0)
    svg = draw(Simulator(made).sheet(), "a & b")
    assert (
        '<polyline class="stroke" points="80.0,536.0 130.0,536.0" stroke="#0102ff" stroke-width="7"/>'
        in svg
    )
    assert svg.count('class="turtle"') == 2
    assert "&lt;u&gt;" in svg
    assert "a &amp; b" in svg
