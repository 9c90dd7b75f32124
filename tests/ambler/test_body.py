"""Body moves: height, duration, and what is refused."""

import math
from dataclasses import replace

import pytest
from ambler.builders import ORIGIN, a_stance, a_step

from robots.ambler_sim.body import ACCELERATION, duration, plan_body_move, plan_shift
from robots.ambler_sim.errors import OutOfReach, UnstableMove
from robots.ambler_sim.vocabulary import Pose


def test_the_body_is_carried_at_the_same_height_over_the_mean_of_its_feet() -> None:
    step = a_step()
    move = plan_body_move(step, replace(step.ideal, z=0.6))
    assert (move.goal.x, move.goal.y) == pytest.approx((0.5, 0.0))
    assert move.goal.height == pytest.approx(2.7 + 0.6 / 6)


def test_the_duration_keeps_the_acceleration_low() -> None:
    seconds = duration(ORIGIN, replace(ORIGIN, x=0.5))
    assert 0.5 * math.pi**2 / (2 * seconds**2) == pytest.approx(ACCELERATION)
    assert duration(ORIGIN, ORIGIN) == 0.5


def test_too_far_a_move_is_refused_naming_the_leg() -> None:
    with pytest.raises(OutOfReach, match=r"leg 2 would need reach 3\.00 m"):
        plan_shift(a_stance(), Pose(1.2, 0.0, 0.0, 2.7))


def test_a_move_to_the_edge_of_the_support_is_refused() -> None:
    stance = a_stance()
    gathered = replace(stance, feet=tuple(replace(foot, x=foot.x / 2 - 0.8) for foot in stance.feet))
    with pytest.raises(UnstableMove, match="from tipping"):
        plan_shift(gathered, ORIGIN)
