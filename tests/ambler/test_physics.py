"""The ground in the physics engine is the ground of the terrain."""

import numpy as np
import pytest

from robots.ambler_sim.plant import standing_posture
from robots.ambler_sim.robot import START
from robots.ambler_sim.terrain import make_terrain
from robots.ambler_sim.vocabulary import TerrainSpec

physics = pytest.importorskip("robots.ambler_sim.physics", exc_type=ImportError)


def test_rays_end_on_the_terrain_wherever_its_middle_height_is() -> None:
    terrain = make_terrain(TerrainSpec(seed=9, slope=0.3, length=20.0))
    plant = physics.BulletPlant(terrain, standing_posture(terrain, START))
    directions = np.array([[0.6, 0.0, -0.8], [0.36, 0.48, -0.8], [0.0, -0.8, -0.6], [0.0, 0.0, 1.0]])
    origin = np.array([1.0, 0.5, 5.0])
    hits = origin + plant.cast(origin, directions, 14.0)[:, None] * directions
    plant.close()
    assert hits[:3, 2] == pytest.approx(terrain.heights_at(hits[:3, 0], hits[:3, 1]), abs=0.01)
    assert np.isnan(hits[3]).all()
