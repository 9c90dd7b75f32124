"""Maps made of scan points."""

from dataclasses import replace

import numpy as np
import pytest
from ambler.builders import a_stance
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.planning.elevation import (
    build_elevation_map,
    height_at,
    heights_of,
    known_cells,
)
from robots.ambler_sim.vocabulary import BodyMove, Pose, TerrainSpec

NO_POINTS = np.empty((0, 3))


def patch(x: float, y: float, height: float) -> Array:
    """Return a dense square metre of points."""
    across, along = np.meshgrid(np.arange(x, x + 1, 0.05), np.arange(y, y + 1, 0.05))
    return np.stack([across.ravel(), along.ravel(), np.full(across.size, height)], axis=1)


def test_points_of_one_cell_are_averaged() -> None:
    ground = build_elevation_map(np.array([[3.0, 0.0, 0.2], [3.01, 0.01, 0.4]]), a_stance())
    assert height_at(ground, 3.0, 0.0) == pytest.approx(0.3)


def test_standing_feet_mark_the_ground_in_the_map() -> None:
    ground = build_elevation_map(NO_POINTS, a_stance(height=0.7))
    assert height_at(ground, -1.5, 2.3) == pytest.approx(0.7)
    assert known_cells(ground).sum() == 6


def test_map_fills_gaps_and_leaves_far_ground_unknown() -> None:
    points = np.vstack([patch(2.0, -0.5, 0.1), patch(4.0, -0.5, 0.3)])
    ground = build_elevation_map(points, a_stance())
    assert 0.1 < height_at(ground, 3.5, 0.0) < 0.3
    assert np.isnan(height_at(ground, -3.0, -4.5))
    assert not known_cells(ground)[round((3.5 - ground.x) / 0.1), round(-ground.y / 0.1)]


def test_unseen_ground_is_remembered_until_seen_again() -> None:
    first = build_elevation_map(patch(2.0, -0.5, 0.4), a_stance())
    moved = a_stance(Pose(0.53, 0.04, 0.02, 2.7))
    second = build_elevation_map(NO_POINTS, moved, first)
    third = build_elevation_map(patch(2.0, -0.5, 0.1), moved, second)
    assert height_at(second, 2.5, 0.0) == pytest.approx(0.4)
    assert height_at(third, 2.5, 0.0) == pytest.approx(0.1)


def test_filled_cells_are_not_remembered_as_measured() -> None:
    first = build_elevation_map(patch(2.0, -0.5, 0.4), a_stance())
    second = build_elevation_map(NO_POINTS, a_stance(), first)
    assert (known_cells(second) == known_cells(first)).all()


@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(-3, 6), st.floats(-4, 4), st.floats(-1, 1)), max_size=40))
def test_map_heights_stay_within_the_measured_range(
    rows: list[tuple[float, float, float]],
) -> None:
    points = np.array(rows).reshape(-1, 3)
    heights = heights_of(build_elevation_map(points, a_stance()))
    lowest, highest = min([0.0, *points[:, 2]]), max([0.0, *points[:, 2]])
    assert np.nanmin(heights) >= lowest - 1e-6
    assert np.nanmax(heights) <= highest + 1e-6


def test_map_of_scanned_hills_is_accurate() -> None:
    robot = make_robot("kinematic", terrain=TerrainSpec(seed=2, slope=0.3))
    ground = build_elevation_map(robot.scan(), robot.stance())
    heights, known = heights_of(ground), known_cells(ground)
    x, y = (
        ground.x + 0.1 * np.indices(heights.shape)[0],
        ground.y + 0.1 * np.indices(heights.shape)[1],
    )
    near = known & (x > 1.0) & (x < 4.0) & (np.abs(y) < 3.0)
    errors = heights[near] - robot.terrain.heights_at(x[near], y[near])
    assert near.sum() > 700
    assert np.sqrt((errors**2).mean()) < 0.03


@pytest.mark.soak
def test_scan_while_the_body_moves_is_blurred() -> None:
    robot = make_robot(
        "kinematic", terrain=TerrainSpec(seed=2, slope=0.3), start=Pose(30.0, 0.0, 0.0, 0.0)
    )
    start = robot.stance().pose
    sharp: list[Array] = []
    blurred: list[Array] = []
    goal = replace(start, x=start.x + 0.4)

    def look() -> bool:
        (blurred if len(sharp) else sharp).append(robot.scan())
        return True

    def off(points: Array) -> float:
        points = points[-2000:]  # the last rows of the scan
        return float(
            np.abs(points[:, 2] - robot.terrain.heights_at(points[:, 0], points[:, 1])).mean()
        )

    robot.move_body(BodyMove(goal, 2.0), look)
    middle = blurred[len(blurred) // 2]
    assert off(sharp[0]) < 0.03
    assert off(middle) > 1.5 * off(sharp[0])
    assert off(robot.scan()) < 0.03
