"""The choice of a foothold from a map."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ambler.builders import a_map, a_step, flat
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.ambler_sim.errors import NoFootfall
from robots.ambler_sim.geometry import AMBLER, Array, circulating_angle, leg_joints
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.planning.footfall import (
    LEG_SPACING,
    SEARCH_RADIUS,
    candidates,
    choose_foothold,
)
from robots.ambler_sim.vocabulary import TerrainSpec


def test_ideal_foothold_is_chosen_on_level_ground() -> None:
    step = a_step()
    foot = choose_foothold(a_map(), step)
    assert foot.leg == step.leg
    assert (foot.x, foot.y, foot.z) == pytest.approx((step.ideal.x, step.ideal.y, 0.0), abs=0.01)


def test_rock_on_the_ideal_foothold_is_avoided() -> None:
    step = a_step()

    def rock(x: Array, y: Array) -> Array:
        return np.where(np.hypot(x - step.ideal.x, y - step.ideal.y) < 0.2, 0.3, 0.0)

    foot = choose_foothold(a_map(rock), step)
    assert 0.3 < math.dist((foot.x, foot.y), (step.ideal.x, step.ideal.y)) <= SEARCH_RADIUS
    assert foot.z == pytest.approx(0.0, abs=0.02)


def test_ledge_beside_a_steep_slope_is_preferred() -> None:
    step = a_step()

    def bank(x: Array, y: Array) -> Array:
        height: Array = flat(x, y) + 0.5 * np.maximum(step.ideal.y + 0.1 - y, 0.0)
        return height

    assert choose_foothold(a_map(bank), step).y > step.ideal.y + 0.1


def test_broken_ground_raises_no_footfall_with_counts() -> None:
    spikes = np.random.default_rng(1)
    with pytest.raises(
        NoFootfall, match=r"no foothold for leg 2 .* of 7\d cells 7\d unsound, \d+ out of reach"
    ):
        choose_foothold(a_map(lambda x, y: spikes.uniform(0, 2.0, x.shape) + 0 * y), a_step())


def test_pit_deeper_than_the_leg_raises_no_footfall() -> None:
    with pytest.raises(NoFootfall, match="out of reach"):
        choose_foothold(a_map(lambda x, y: flat(x, y) - 3.0), a_step())


def test_unknown_ground_raises_no_footfall() -> None:
    with pytest.raises(NoFootfall, match="of 0 cells"):
        choose_foothold(a_map(lambda x, y: np.where(x > 0.5, np.nan, 0.0) + 0 * y), a_step())
    with pytest.raises(NoFootfall, match="of 0 cells"):
        choose_foothold(a_map(size=1.0), a_step())


def test_plane_has_constant_slope_and_no_roughness() -> None:
    cells = candidates(a_map(lambda x, y: 0.3 * x + 0.4 * y), a_step().ideal)
    assert cells.slope == pytest.approx(np.full(len(cells.slope), 0.5), abs=1e-4)
    assert cells.roughness == pytest.approx(np.zeros(len(cells.slope)), abs=1e-4)
    assert cells.curvature == pytest.approx(np.zeros(len(cells.slope)), abs=1e-3)


@settings(max_examples=30)
@given(st.integers(0, 999), st.floats(0.05, 0.3), st.floats(-0.1, 0.1))
def test_chosen_foothold_stays_in_reach_until_the_leg_is_lifted(
    seed: int, slope: float, curvature: float
) -> None:
    terrain = Terrain(TerrainSpec(seed, slope))
    ground = a_map(lambda x, y: terrain.heights_at(x, y) - terrain.height(0.0, 0.0))
    step = a_step(curvature)
    foot = choose_foothold(ground, step)
    assert math.dist((foot.x, foot.y), (step.ideal.x, step.ideal.y)) <= SEARCH_RADIUS
    for pose in step.support:
        _, reach, _ = leg_joints(pose, foot)
        assert AMBLER.min_reach < reach < AMBLER.max_reach
    others = [other for other in step.before.feet if other.leg != foot.leg]
    assert min(math.dist((foot.x, foot.y), (other.x, other.y)) for other in others) > 0.3


def test_foothold_keeps_distance_from_another_foot() -> None:
    step = a_step()
    x, y = step.ideal.x, step.ideal.y - 0.1
    standing = replace(
        step.before, feet=(replace(step.before.feet[0], x=x, y=y), *step.before.feet[1:])
    )
    foot = choose_foothold(a_map(), replace(step, before=standing))
    assert math.dist((foot.x, foot.y), (x, y)) >= LEG_SPACING
    assert circulating_angle(standing.pose, foot) < circulating_angle(
        standing.pose, standing.feet[0]
    )
