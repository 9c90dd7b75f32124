"""The gait: the next leg, its foothold, and progress along the arc."""

import itertools
import math
from dataclasses import replace

import pytest
from ambler.builders import ORIGIN, a_stance, a_step, an_arc
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.ambler_sim.errors import NoStep, OutOfReach, UnstableMove
from robots.ambler_sim.geometry import is_left, stance_joints, within_limits
from robots.ambler_sim.planning.gait import (
    ACCELERATION,
    ADVANCE,
    after_step,
    duration,
    next_step,
    plan_body_move,
    plan_shift,
    pose_on,
    progress,
    remaining,
)
from robots.ambler_sim.planning.stability import support_margin
from robots.ambler_sim.vocabulary import LEGS, Arc, Foot, Pose, Step

curvatures = st.floats(-0.12, 0.12)
poses = st.builds(Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9), st.just(2.7))


def planned_steps(arc: Arc, count: int) -> list[Step]:
    """Steps planned ahead, each from the predicted stance after the previous one."""
    steps, stance = [], a_stance(arc.start)
    for _ in range(count):
        steps.append(next_step(stance, arc))
        stance = after_step(steps[-1], steps[-1].ideal, steps[-1].goal)
    return steps


def test_rear_most_leg_steps_first_and_sides_alternate() -> None:
    legs = [step.leg for step in planned_steps(an_arc(length=8.0), 12)]
    assert legs == [2, 5, 1, 4, 0, 3] * 2


@given(curvatures)
@settings(max_examples=20)
def test_each_leg_steps_once_in_six_on_every_arc(
    curvature: float,
) -> None:
    steps = planned_steps(an_arc(curvature, 9.0), 18)
    for six in (steps[i : i + 6] for i in range(12)):
        assert {step.leg for step in six} == set(LEGS)
        assert all(is_left(a.leg) != is_left(b.leg) for a, b in itertools.pairwise(six))


@given(curvatures)
@settings(max_examples=20)
def test_planned_stances_are_in_reach_and_stable(curvature: float) -> None:
    for step in planned_steps(an_arc(curvature, 9.0), 14)[1:]:
        assert within_limits(stance_joints(step.before)).all()
        assert support_margin(step.before, step.leg) > 0.3


def test_step_advances_half_a_metre_and_places_the_foot_ahead() -> None:
    step = next_step(a_stance(), an_arc())
    assert step.goal.x == pytest.approx(ADVANCE)
    assert (step.ideal.x, step.ideal.y) == pytest.approx((1.5, 2.3))
    assert step.remaining == pytest.approx(5.5)
    assert [pose.x for pose in step.support] == pytest.approx([0.5 * number for number in range(7)])


def test_last_step_ends_where_the_arc_ends() -> None:
    step = next_step(a_stance(), an_arc(length=0.3))
    assert step.goal.x == pytest.approx(0.3)
    assert step.remaining == 0.0


def test_walked_arc_has_no_next_step() -> None:
    with pytest.raises(NoStep, match="has been walked"):
        next_step(a_stance(Pose(5.95, 0.0, 0.0, 2.7)), an_arc(length=6.0))


def test_next_step_returns_the_body_to_the_arc() -> None:
    step = next_step(a_stance(Pose(1.0, 0.2, 0.1, 2.7)), an_arc())
    assert (step.goal.x, step.goal.y, step.goal.heading) == pytest.approx((1.5, 0.0, 0.0))


@given(poses, curvatures, st.floats(0.0, 70.0))
def test_progress_is_the_distance_along_the_arc(
    start: Pose, curvature: float, distance: float
) -> None:
    arc = Arc(start, curvature, 80.0)
    assert progress(arc, pose_on(arc, distance)) == pytest.approx(distance, abs=1e-4)
    assert remaining(arc, pose_on(arc, distance)) == pytest.approx(80.0 - distance, abs=1e-4)


def test_pose_after_a_quarter_circle_is_at_its_radius() -> None:
    pose = pose_on(an_arc(curvature=0.1), math.pi / 2 / 0.1)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((10.0, 10.0, math.pi / 2))


def test_stance_after_step_changes_one_foot_and_the_pose() -> None:
    step = next_step(a_stance(), an_arc())
    landed = Foot(step.leg, 1.4, 2.2, 0.3)
    stance = after_step(step, landed, step.goal)
    assert stance.pose == step.goal
    assert stance.last_leg == step.leg
    assert [foot for foot in stance.feet if foot not in step.before.feet] == [landed]


def test_step_does_not_depend_on_the_start_of_the_arc() -> None:
    turned = Pose(3.0, -2.0, 1.0, 2.7)
    here, there = next_step(a_stance(), an_arc()), next_step(a_stance(turned), an_arc(start=turned))
    assert here.leg == there.leg
    assert math.dist((here.ideal.x, here.ideal.y), (ORIGIN.x, ORIGIN.y)) == pytest.approx(
        math.dist((there.ideal.x, there.ideal.y), (turned.x, turned.y))
    )


def test_body_height_follows_the_mean_height_of_its_feet() -> None:
    step = a_step()
    move = plan_body_move(step, replace(step.ideal, z=0.6))
    assert (move.goal.x, move.goal.y) == pytest.approx((0.5, 0.0))
    assert move.goal.height == pytest.approx(2.7 + 0.6 / 6)


def test_move_duration_limits_the_acceleration() -> None:
    seconds = duration(ORIGIN, replace(ORIGIN, x=0.5))
    assert 0.5 * math.pi**2 / (2 * seconds**2) == pytest.approx(ACCELERATION)
    assert duration(ORIGIN, ORIGIN) == 0.5


def test_body_move_out_of_reach_names_the_leg() -> None:
    with pytest.raises(OutOfReach, match=r"leg 2 would need reach 3\.00 m"):
        plan_shift(a_stance(), Pose(1.2, 0.0, 0.0, 2.7))


def test_move_to_the_support_edge_is_refused() -> None:
    stance = a_stance()
    gathered = replace(
        stance, feet=tuple(replace(foot, x=foot.x / 2 - 0.8) for foot in stance.feet)
    )
    with pytest.raises(UnstableMove, match="from tipping"):
        plan_shift(gathered, ORIGIN)
