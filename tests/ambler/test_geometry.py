"""The mechanism: inverse and forward kinematics, frames, circulation."""

import math

import numpy as np
import pytest
from ambler.builders import ORIGIN, a_stance
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.ambler_sim.geometry import (
    AMBLER,
    circulating_angle,
    feet_of,
    joints_of,
    leg_joints,
    stance_joints,
    to_body,
    to_world,
    unwrap,
    within_limits,
)
from robots.ambler_sim.vocabulary import LEGS, Foot, Pose

angles = st.floats(-20.0, 20.0)
places = st.floats(-50.0, 50.0)
poses = st.builds(Pose, x=places, y=places, heading=angles, height=st.floats(0.0, 6.0))
reaches = st.floats(AMBLER.min_reach, AMBLER.max_reach)
drops = st.floats(AMBLER.min_drop, AMBLER.max_drop)


@given(poses, st.lists(st.tuples(angles, reaches, drops), min_size=6, max_size=6))
@settings(max_examples=30)
def test_kinematics_of_all_legs_agrees_with_one_at_a_time(
    pose: Pose, rows: list[tuple[float, float, float]]
) -> None:
    joints = np.array(rows)
    feet = to_world(pose, feet_of(joints))
    again = joints_of(to_body(pose, feet), near=joints[:, 0])
    one_by_one = [
        leg_joints(pose, Foot(leg, *map(float, feet[leg])), near=rows[leg][0]) for leg in LEGS
    ]
    np.testing.assert_allclose(again, joints, atol=1e-6)
    np.testing.assert_allclose(one_by_one, joints, atol=1e-6)


@given(angles, angles)
def test_unwrap_changes_whole_turns_only_and_stays_near(angle: float, near: float) -> None:
    result = unwrap(angle, near)
    assert abs(result - near) <= math.pi + 1e-9
    assert math.remainder(result - angle, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_foot_beside_its_shaft_has_a_quarter_turn() -> None:
    assert leg_joints(ORIGIN, Foot(0, 0.0, 2.5, 0.0)) == pytest.approx((math.pi / 2, 1.5, 2.7))
    assert leg_joints(ORIGIN, Foot(3, 0.0, -2.5, 0.0)) == pytest.approx((-math.pi / 2, 1.5, 3.5))


def test_standard_stance_is_within_limits() -> None:
    assert within_limits(stance_joints(a_stance()), reserve=0.1).all()
    assert 2 * (AMBLER.shaft_offset + AMBLER.max_reach) == 7.0
    assert AMBLER.mass == 2500.0


def test_joint_limits_restrict_reach_and_drop() -> None:
    rows = np.array([[0.0, 0.9, 2.0], [9.0, 1.5, 2.0], [0.0, 2.6, 2.0], [0.0, 2.0, 5.1]])
    assert within_limits(rows).tolist() == [False, True, False, False]
    assert within_limits(rows, reserve=-0.2).all()


def test_leg_stopped_under_the_body_counts_as_rear_most() -> None:
    inside = Foot(0, 0.3, -0.1, 0.0)
    behind = Foot(2, -1.5, 2.3, 0.0)
    assert circulating_angle(ORIGIN, inside) > circulating_angle(ORIGIN, behind)
