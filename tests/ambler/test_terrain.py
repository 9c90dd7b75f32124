"""The ground: repeatable, as steep as asked for, smooth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.ambler_sim.terrain import make_terrain, on_path, steepest
from robots.ambler_sim.vocabulary import TerrainSpec


@given(st.integers(0, 10**6), st.floats(0.02, 0.4))
def test_the_steepest_gradient_on_the_path_is_the_one_asked_for(seed: int, slope: float) -> None:
    terrain = make_terrain(TerrainSpec(seed, slope, length=20.0))
    assert steepest(on_path(terrain)) == pytest.approx(slope)


def test_the_same_seed_makes_the_same_ground_and_another_one_another() -> None:
    first, again, other = (make_terrain(TerrainSpec(seed)).heights for seed in (3, 3, 4))
    assert (first == again).all()
    assert not (first == other).all()


def test_between_grid_points_heights_are_bilinear() -> None:
    terrain = make_terrain(TerrainSpec())
    corners = terrain.heights[24:26, 32:34]
    assert terrain.height(0.0, 0.0) == pytest.approx(corners[0, 0])
    assert terrain.height(0.125, 0.125) == pytest.approx(corners.mean())


def test_slope_and_normal_belong_together() -> None:
    terrain = make_terrain(TerrainSpec(slope=0.3))
    normal = terrain.normal(3.0, 1.0)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert np.hypot(normal[0], normal[1]) / normal[2] == pytest.approx(terrain.slope(3.0, 1.0))


def test_the_ground_ends_and_goes_on_level_for_the_sums() -> None:
    terrain = make_terrain(TerrainSpec())
    assert terrain.contains(33.9, 7.9)
    assert not terrain.contains(34.1, 0.0)
    assert terrain.height(50.0, 0.0) == pytest.approx(terrain.height(34.0, 0.0), abs=1e-3)
