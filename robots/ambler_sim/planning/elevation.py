"""Elevation maps, the robot's belief about the ground: how they are built and read."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from robots.ambler_sim.geometry import Array, offset, positions
from robots.ambler_sim.vocabulary import ElevationMap, Obstacle, Scan, Stance, Window

Mask = NDArray[np.bool_]

RESOLUTION = 0.1
SIZE = 10.0
"""The length (m) of each side of a map."""

AHEAD = 1.5
"""How far (m) the middle of a map is ahead of the body."""

FILL_REACH = 1.5
"""How far (m) from measured cells unknown ones are filled in."""


def make_map(x: float, y: float, heights: Array, known: Mask) -> ElevationMap:
    """Return a map whose first cell has its centre at *x*, *y*."""
    rows, columns = heights.shape
    return ElevationMap(
        x,
        y,
        RESOLUTION,
        rows,
        columns,
        heights.astype("<f4").tobytes(),
        known.astype("u1").tobytes(),
    )


def heights_of(ground: ElevationMap) -> Array:
    """Return the cells' heights (rows, columns); NaN where nothing is known nearby."""
    cells = np.frombuffer(ground.heights, dtype="<f4").reshape(ground.rows, ground.columns)
    return cells.astype(np.float64)


def known_cells(ground: ElevationMap) -> Mask:
    """Return which cells were measured. All other cells are filled in from their neighbours, or
    NaN.
    """
    return np.frombuffer(ground.known, dtype="u1").reshape(ground.rows, ground.columns).astype(bool)


def heights_along(ground: ElevationMap, x: Array, y: Array) -> Array:
    """Return the height of the cell below each point; NaN off the map."""
    row = np.rint((x - ground.x) / ground.resolution).astype(np.intp)
    column = np.rint((y - ground.y) / ground.resolution).astype(np.intp)
    inside = (row >= 0) & (row < ground.rows) & (column >= 0) & (column < ground.columns)
    heights = heights_of(ground)[row.clip(0, ground.rows - 1), column.clip(0, ground.columns - 1)]
    return np.where(inside, heights, np.nan)


def height_at(ground: ElevationMap, x: float, y: float) -> float:
    """Return the height of one cell; NaN where it is unknown."""
    return float(heights_along(ground, np.array([x]), np.array([y]))[0])


def unknown_map(window: Window) -> ElevationMap:
    """Return a map without any known cell."""
    return cut(
        make_map(window.x, window.y, np.array([[np.nan]]), np.zeros((1, 1), dtype=bool)), window
    )


def cut(ground: ElevationMap, window: Window) -> ElevationMap:
    """Return the part of a map in a window; cells outside the map are NaN."""
    side = 2 * math.ceil(window.reach / ground.resolution) + 1
    row = round((window.x - window.reach - ground.x) / ground.resolution)
    column = round((window.y - window.reach - ground.y) / ground.resolution)
    heights, known = np.full((side, side), np.nan), np.zeros((side, side), dtype=bool)
    rows, columns = row + np.arange(side), column + np.arange(side)
    is_row = (rows >= 0) & (rows < ground.rows)
    is_column = (columns >= 0) & (columns < ground.columns)
    target, source = np.ix_(is_row, is_column), np.ix_(rows[is_row], columns[is_column])
    heights[target], known[target] = heights_of(ground)[source], known_cells(ground)[source]
    x, y = ground.x + row * ground.resolution, ground.y + column * ground.resolution
    return make_map(x, y, heights, known)


def with_obstacles(ground: ElevationMap, obstacles: Iterable[Obstacle]) -> ElevationMap:
    """Return the map with the felt obstacles: walls are infinitely high, bad footholds are NaN."""
    heights = heights_of(ground).copy()
    rows, columns = np.indices(heights.shape)
    for each in obstacles:
        away = np.hypot(
            ground.x + ground.resolution * rows - each.x,
            ground.y + ground.resolution * columns - each.y,
        )
        heights[away <= each.radius] = math.inf if each.is_wall else math.nan
    return make_map(ground.x, ground.y, heights, known_cells(ground))


# --- from range images ----------------------------------------------------------------------------


def pack_scan(stance: Stance, points: Array) -> Scan:
    """Pack a scan as a message."""
    return Scan(stance, points.astype("<f4").tobytes())


def points_of(scan: Scan) -> Array:
    """Return the world points (n, 3) of a scan."""
    return np.frombuffer(scan.points, dtype="<f4").reshape(-1, 3).astype(np.float64)


def build_elevation_map(
    points: Array, stance: Stance, previous: ElevationMap | None = None
) -> ElevationMap:
    """Map the ground around the robot: the mean height of the *points* in each cell.

    The feet count as points, too, because the robot knows the ground best there. Cells without
    points are taken from the *previous* map. The rest are filled in from neighbours up to
    FILL_REACH away; farther cells stay NaN.
    """
    x, y = _corner(stance)
    heights = _cell_means(np.vstack([points, positions(stance)]), x, y)
    if previous is not None:
        # The cut part has one more row and column.
        older = cut(previous, Window(x + SIZE / 2, y + SIZE / 2, SIZE / 2))
        measured = np.where(known_cells(older), heights_of(older), np.nan)[:-1, :-1]
        heights = np.where(np.isfinite(heights), heights, measured)
    known = np.isfinite(heights)
    return make_map(x, y, _filled(heights), known)


def _corner(stance: Stance) -> tuple[float, float]:
    """Return the first cell of a map that reaches ahead, on the lattice that all maps share."""
    centre_x, centre_y = offset(stance.pose, AHEAD, 0.0)
    return _on_lattice(centre_x - SIZE / 2), _on_lattice(centre_y - SIZE / 2)


def _on_lattice(value: float) -> float:
    return round(value / RESOLUTION) * RESOLUTION


def _cell_means(points: Array, x: float, y: float) -> Array:
    """Return the mean height of the points in each cell; NaN without points."""
    side = round(SIZE / RESOLUTION)
    cells = np.rint((points[:, :2] - (x, y)) / RESOLUTION).astype(np.intp)
    inside = ((cells >= 0) & (cells < side)).all(axis=1)
    index = cells[inside] @ (side, 1)
    count = np.bincount(index, minlength=side * side)
    total = np.bincount(index, weights=points[inside, 2], minlength=side * side)
    means = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return means.reshape(side, side)


def _filled(heights: Array) -> Array:
    """Fill unknown cells with means of their neighbours, outwards from known cells. Then smooth the
    filled cells.
    """
    unknown = ~np.isfinite(heights)
    cells = heights.copy()
    for _ in range(math.ceil(FILL_REACH / RESOLUTION)):
        missing = ~np.isfinite(cells)
        if not missing.any():
            break
        cells = np.where(missing, _neighbour_means(cells, ~missing), cells)
    for _ in range(4):
        cells = np.where(unknown, _neighbour_means(cells, np.isfinite(cells)), cells)
    return cells


def _neighbour_means(cells: Array, valid: Mask) -> Array:
    """Return the mean over each cell's valid 3x3 neighbourhood; NaN without a valid cell."""
    total = _box_sum(np.where(valid, cells, 0.0))
    count = _box_sum(valid.astype(np.float64))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _box_sum(cells: Array) -> Array:
    padded = np.pad(cells, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    total: Array = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return total
