"""The terrain: repeatable, smooth, and as steep as requested."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.ambler_sim.machine.plant import standing_posture
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.vocabulary import ORIGIN, TERRAINS, Rock, TerrainSpec


@given(st.integers(0, 10**6), st.floats(0.02, 0.4), st.floats(-0.6, 0.6))
@settings(max_examples=15)
def test_hills_reach_the_requested_slope_and_never_exceed_it(
    seed: int, slope: float, heading: float
) -> None:
    """The rule holds along any path of 60 m from the start."""
    terrain = Terrain(TerrainSpec(seed, slope))
    ways = np.arange(0.0, 60.0, 0.25)
    slopes = [terrain.gradient_at(way * np.cos(heading), way * np.sin(heading)) for way in ways]
    assert max(slopes) <= slope * 1.001
    assert max(slopes) >= 0.6 * slope
    assert max(slopes[:20]) <= 0.3 * slope  # the start is gentle


def test_long_walk_meets_the_steepest_slope() -> None:
    terrain = Terrain(TerrainSpec(seed=5, slope=0.3))
    assert 0.28 <= max(terrain.gradient_at(x, 0.0) for x in np.arange(0.0, 300.0, 0.5)) <= 0.3


@pytest.mark.parametrize("kind", TERRAINS)
def test_terrain_depends_on_its_seed_only(kind: str) -> None:
    x, y = np.meshgrid(np.linspace(-5.0, 60.0, 80), np.linspace(-9.0, 9.0, 40))
    first, again, other = (
        Terrain(TerrainSpec(seed, 0.3, kind=kind)).heights_at(x, y) for seed in (3, 3, 4)
    )
    assert (first == again).all()
    assert (first == other).all() == (kind == "flat")


@given(st.floats(-900, 900), st.floats(-900, 900))
@settings(max_examples=20)
def test_terrain_height_does_not_depend_on_earlier_queries(x: float, y: float) -> None:
    walked, fresh = Terrain(TerrainSpec(7, 0.3)), Terrain(TerrainSpec(7, 0.3))
    walked.height(x + 20.0, y - 30.0)
    assert walked.height(x, y) == fresh.height(x, y)
    far = fresh.heights_at(np.array([x, x + 500.0]), np.array([y, y]))[
        0
    ]  # too far apart to be cached
    assert far == pytest.approx(walked.height(x, y), abs=1e-9)


def test_soft_terrain_has_some_soft_ground() -> None:
    x, y = np.meshgrid(np.linspace(10.0, 60.0, 100), np.linspace(-9.0, 9.0, 40))
    soft = Terrain(TerrainSpec(kind="soft")).firmness_at(x, y) < 1
    assert 0.005 < soft.mean() < 0.2


def test_physics_engine_rays_end_on_the_terrain() -> None:
    physics = pytest.importorskip("robots.ambler_sim.machine.physics", exc_type=ImportError)
    terrain = Terrain(TerrainSpec(seed=9, slope=0.3))
    plant = physics.BulletPlant(terrain, standing_posture(terrain, ORIGIN))
    directions = np.array(
        [[0.6, 0.0, -0.8], [0.36, 0.48, -0.8], [0.0, -0.8, -0.6], [0.0, 0.0, 1.0]]
    )
    origin = np.array([1.0, 0.5, 5.0])
    hits = origin + plant.cast(origin, directions, 14.0)[:, None] * directions
    plant.close()
    assert hits[:3, 2] == pytest.approx(terrain.heights_at(hits[:3, 0], hits[:3, 1]), abs=0.01)
    assert np.isnan(hits[3]).all()


def test_ground_collapses_only_where_it_gives_way() -> None:
    terrain, untouched = Terrain(TerrainSpec(slope=0.3)), Terrain(TerrainSpec(slope=0.3))
    terrain.give_way(2.0, 1.0)
    x, y = np.array([2.0, 2.2, 2.4, 2.9, 700.0]), np.ones(5)
    fallen = untouched.heights_at(x, y) - terrain.heights_at(x, y)
    assert fallen == pytest.approx([0.25, 0.25, 0.125, 0.0, 0.0], abs=0.06)
    again = Terrain(terrain.present)
    assert again.heights_at(x, y) == pytest.approx(terrain.heights_at(x, y))


def test_distant_rocks_do_not_evict_the_cached_ground() -> None:
    """Only one part of the ground is cached, so alternating queries would rebuild it each time."""
    terrain, rock = Terrain(TerrainSpec(seed=7, slope=0.3)), Rock(0.0, 1.0, 0.2, 0.5)
    top = terrain.top(rock)
    terrain.height(400.0, 0.0)
    kept = terrain._cached
    assert terrain.top(rock) == top
    assert terrain._cached is kept
