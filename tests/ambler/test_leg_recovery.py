"""Leg trajectories: height over the ground, sense of rotation, and joint segments."""

import itertools
import math

import numpy as np
import pytest
from ambler.builders import ORIGIN, a_map, a_stance, a_step, flat
from hypothesis import given
from hypothesis import strategies as st

from robots.ambler_sim.errors import OutOfReach, PathBlocked
from robots.ambler_sim.geometry import Array, feet_of, leg_joints, to_world
from robots.ambler_sim.machine.motion import GUARD, SPEEDS, leg_segments
from robots.ambler_sim.planning.leg_recovery import (
    CLEARANCE,
    plan_leg_move,
    plan_swing,
    rotation,
    swing_path,
)
from robots.ambler_sim.vocabulary import Foot, LegMove, Step

angles = st.floats(-10.0, 10.0)


@given(angles, angles, st.sampled_from((-1, 0, 1)))
def test_rotation_reaches_its_end_angle_in_the_given_sense(
    start: float, end: float, sense: int
) -> None:
    turn = rotation(start, end, sense)
    assert math.remainder(start + turn - end, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert turn * sense >= 0
    assert abs(turn) <= (math.tau if sense else math.pi)


def test_foot_is_lifted_by_the_clearance_on_level_ground() -> None:
    step = a_step()
    move = plan_leg_move(a_map(), step, step.ideal)
    assert move == LegMove(2, step.ideal, lift=CLEARANCE, radius=1.15, sense=1)


def test_right_stack_turns_the_other_way() -> None:
    step = a_step()
    mirrored = Step(5, Foot(5, 1.5, -2.3, 0.0), step.goal, step.before, step.support, 1.0)
    assert plan_leg_move(a_map(), mirrored, mirrored.ideal).sense == -1


def a_wall(x: Array, y: Array) -> Array:
    """Return a wall 1 m high, only where the leg passes under the body."""
    return np.where((np.abs(x) < 0.15) & (y > -0.3) & (y < 0.1), 1.0, 0.0)


def test_only_an_obstacle_in_the_path_raises_the_lift() -> None:
    step = a_step()
    assert plan_leg_move(a_map(a_wall), step, step.ideal).lift == pytest.approx(1.0 + CLEARANCE)
    assert plan_leg_move(
        a_map(lambda x, y: a_wall(x, y - 1.5)), step, step.ideal
    ).lift == pytest.approx(CLEARANCE)


def test_wall_higher_than_the_lift_limit_blocks_the_path() -> None:
    step = a_step()
    with pytest.raises(PathBlocked, match=r"leg 2 would have to be lifted to 3\.45 m"):
        plan_leg_move(a_map(lambda x, y: 3 * a_wall(x, y)), step, step.ideal)


def test_foothold_out_of_reach_is_refused() -> None:
    with pytest.raises(OutOfReach, match="leg 2 cannot reach"):
        plan_swing(a_map(), a_stance(), Foot(2, 4.0, 2.3, 0.0))


def test_leg_recovery_path_passes_between_the_shafts() -> None:
    move = plan_leg_move(a_map(), a_step(), a_step().ideal)
    start = leg_joints(ORIGIN, a_stance().feet[2])
    end = leg_joints(ORIGIN, move.foothold)
    path = swing_path(
        ORIGIN, 2, start[:2], (start[0] + rotation(start[0], end[0], 1), end[1]), move.radius
    )
    assert path[0] == pytest.approx((-1.5, 2.3))
    assert path[-1] == pytest.approx((1.5, 2.3))
    assert path[:, 1].min() == pytest.approx(1.0 - 1.15, abs=0.01)
    assert np.hypot(*np.diff(path, axis=0).T).max() < 0.06


def test_leg_segments_join_and_end_above_the_foothold() -> None:
    stance, move = a_stance(), plan_leg_move(a_map(flat), a_step(), a_step().ideal)
    segments = leg_segments(move, stance.pose, np.array(leg_joints(stance.pose, stance.feet[2])))
    for first, second in itertools.pairwise(segments):
        assert (first.at(1.0) == second.at(0.0)).all()
    lifted = to_world(stance.pose, feet_of(segments[0].end[None, :], [2]))[0]
    lowered = to_world(stance.pose, feet_of(segments[-1].end[None, :], [2]))[0]
    assert lifted == pytest.approx((-1.5, 2.3, CLEARANCE))
    assert lowered == pytest.approx((1.5, 2.3, GUARD))


def test_joint_speeds_stay_within_limits() -> None:
    stance, move = a_stance(), plan_leg_move(a_map(flat), a_step(), a_step().ideal)
    for segment in leg_segments(
        move, stance.pose, np.array(leg_joints(stance.pose, stance.feet[2]))
    ):
        joints = np.array([segment.at(share) for share in np.linspace(0, 1, 101)])
        rates = np.abs(np.diff(joints, axis=0)) / (segment.duration / 100)
        assert (rates <= SPEEDS * 1.001).all()
