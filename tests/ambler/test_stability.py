"""Support polygon, margins and energy stability."""

import numpy as np
import pytest
from ambler.builders import a_stance
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.ambler_sim.geometry import feet_of, stance_joints, to_world
from robots.ambler_sim.planning.stability import (
    centre_of_gravity,
    conservative_margin,
    energy_margin,
    least_norm_loads,
    support_margin,
    support_polygon,
    world_centre_of_gravity,
)
from robots.ambler_sim.vocabulary import Foot, Pose, Stance

shifts = st.floats(-0.4, 0.4)


def shifted(forward: float, left: float) -> Stance:
    """Return a stance whose body is moved over standing feet."""
    stance = a_stance()
    return Stance(Pose(forward, left, 0.0, stance.pose.height), stance.feet)


def test_symmetric_robot_has_its_centre_of_gravity_in_the_middle() -> None:
    joints = stance_joints(a_stance())
    mirrored = joints.copy()
    mirrored[3:, 0], mirrored[3:, 1] = -joints[2::-1, 0], joints[2::-1, 1]
    assert centre_of_gravity(mirrored)[1] == pytest.approx(0.0, abs=1e-9)


@given(shifts, shifts)
@settings(max_examples=30)
def test_support_margin_agrees_with_brute_force(forward: float, left: float) -> None:
    """Brute force finds the nearest line through two feet that has all other feet on one side."""
    stance = shifted(forward, left)
    points = np.array([[foot.x, foot.y] for foot in stance.feet])
    centre = world_centre_of_gravity(stance)[:2]
    found = []
    for a in points:
        for b in points:
            normal = np.array([a[1] - b[1], b[0] - a[0]])
            if normal.any() and ((points - a) @ normal >= -1e-9).all():
                found.append(float((centre - a) @ normal / np.linalg.norm(normal)))
    assert support_margin(stance) == pytest.approx(min(found))


def test_lifting_a_leg_reduces_the_support_margin() -> None:
    stance = a_stance()
    assert support_margin(stance) > support_margin(stance, 2) > 0.3
    assert conservative_margin(stance) <= support_margin(stance, 2)


def test_energy_margin_is_the_lift_over_the_nearest_edge() -> None:
    stance = a_stance()
    height, margin = world_centre_of_gravity(stance)[2], support_margin(stance, 2)
    assert energy_margin(stance, 2) == pytest.approx(np.hypot(height, margin) - height)


def test_support_polygon_is_counter_clockwise_and_convex() -> None:
    stance = a_stance()
    inner = Stance(stance.pose, (Foot(0, 0.0, 0.0, 0.0), *stance.feet[1:]))
    corners = support_polygon(inner)
    following = np.roll(corners, -1, axis=0)
    area = (corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum() / 2
    assert len(corners) == 4
    assert area > 0


@given(st.lists(st.floats(0.0, 9000.0), min_size=6, max_size=6))
def test_least_norm_loads_keep_sum_and_moments(loads: list[float]) -> None:
    feet = to_world(Pose(0, 0, 0, 0), feet_of(stance_joints(a_stance())))
    given_loads = np.array(loads)
    even = least_norm_loads(feet, given_loads)
    for arm in (np.ones(6), feet[:, 0], feet[:, 1]):
        assert arm @ even == pytest.approx(arm @ given_loads, abs=1e-6)
    assert np.linalg.norm(even) <= np.linalg.norm(given_loads) + 1e-6


def test_support_margin_is_negative_when_the_body_leans_out() -> None:
    assert support_margin(shifted(2.5, 0.0)) < 0
    assert energy_margin(shifted(2.5, 0.0)) < 0
