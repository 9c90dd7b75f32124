"""The ground: repeatable, as steep as asked for, smooth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.ambler_sim.machine.making import START
from robots.ambler_sim.machine.plant import standing_posture
from robots.ambler_sim.machine.terrain import PATH_HALF_WIDTH, RESOLUTION, make_terrain, steepest
from robots.ambler_sim.vocabulary import TerrainSpec


@given(st.integers(0, 10**6), st.floats(0.02, 0.4))
@settings(max_examples=15)
def test_the_steepest_gradient_on_the_path_is_the_one_asked_for(seed: int, slope: float) -> None:
    terrain = make_terrain(TerrainSpec(seed, slope, length=20.0))
    columns = terrain.y0 + RESOLUTION * np.arange(terrain.heights.shape[1])
    assert steepest(terrain.heights[:, np.abs(columns) <= PATH_HALF_WIDTH]) == pytest.approx(slope)


def test_the_same_seed_makes_the_same_ground_and_another_one_another() -> None:
    first, again, other = (make_terrain(TerrainSpec(seed)).heights for seed in (3, 3, 4))
    assert (first == again).all()
    assert not (first == other).all()


def test_between_grid_points_heights_are_bilinear() -> None:
    terrain = make_terrain(TerrainSpec())
    corners = terrain.heights[24:26, 32:34]
    assert terrain.height(0.0, 0.0) == pytest.approx(corners[0, 0])
    assert terrain.height(0.125, 0.125) == pytest.approx(corners.mean())


def test_the_ground_ends_and_goes_on_level_for_the_sums() -> None:
    terrain = make_terrain(TerrainSpec())
    assert terrain.height(50.0, 0.0) == pytest.approx(terrain.height(34.0, 0.0), abs=1e-3)


def test_rays_in_the_physics_engine_end_on_the_terrain_wherever_its_middle_height_is() -> None:
    physics = pytest.importorskip("robots.ambler_sim.machine.physics", exc_type=ImportError)
    terrain = make_terrain(TerrainSpec(seed=9, slope=0.3, length=20.0))
    plant = physics.BulletPlant(terrain, standing_posture(terrain, START))
    directions = np.array([[0.6, 0.0, -0.8], [0.36, 0.48, -0.8], [0.0, -0.8, -0.6], [0.0, 0.0, 1.0]])
    origin = np.array([1.0, 0.5, 5.0])
    hits = origin + plant.cast(origin, directions, 14.0)[:, None] * directions
    plant.close()
    assert hits[:3, 2] == pytest.approx(terrain.heights_at(hits[:3, 0], hits[:3, 1]), abs=0.01)
    assert np.isnan(hits[3]).all()
