"""From range-scan points to an elevation map."""

import math

import numpy as np

from robots.ambler_sim.geometry import Array, offset, positions
from robots.ambler_sim.planning.elevation import Mask, heights_of, known_cells, make_map, overlap
from robots.ambler_sim.vocabulary import ElevationMap, Scan, Stance

RESOLUTION = 0.1
SIZE = 10.0
AHEAD = 1.5
FILL_REACH = 1.5


def pack_scan(stance: Stance, points: Array) -> Scan:
    """A scan as a message."""
    return Scan(stance, points.astype("<f4").tobytes())


def points_of(scan: Scan) -> Array:
    """The world points (n, 3) of a scan."""
    return np.frombuffer(scan.points, dtype="<f4").reshape(-1, 3).astype(np.float64)


def build_elevation_map(points: Array, stance: Stance, previous: ElevationMap | None = None) -> ElevationMap:
    """The ground around the robot: mean height of the *points* in each cell.

    The feet count as points too: they are where the robot knows the ground best. Cells that were not seen are taken
    from the *previous* map, then filled in from neighbours up to FILL_REACH away; farther cells stay NaN.
    """
    x, y = _corner(stance)
    heights = _cell_means(np.vstack([points, positions(stance)]), x, y)
    if previous is not None:
        _take_over(heights, x, y, previous)
    known = np.isfinite(heights)
    return make_map(x, y, RESOLUTION, _filled(heights), known)


def _corner(stance: Stance) -> tuple[float, float]:
    """The first cell of a map that reaches ahead; on multiples of the resolution, so that maps can be laid together."""
    centre_x, centre_y = offset(stance.pose, AHEAD, 0.0)
    return _on_lattice(centre_x - SIZE / 2), _on_lattice(centre_y - SIZE / 2)


def _on_lattice(value: float) -> float:
    return round(value / RESOLUTION) * RESOLUTION


def _cell_means(points: Array, x: float, y: float) -> Array:
    """The mean height of the points in each cell; NaN in cells without."""
    side = round(SIZE / RESOLUTION)
    cells = np.rint((points[:, :2] - (x, y)) / RESOLUTION).astype(np.intp)
    inside = ((cells >= 0) & (cells < side)).all(axis=1)
    index = cells[inside] @ (side, 1)
    count = np.bincount(index, minlength=side * side)
    total = np.bincount(index, weights=points[inside, 2], minlength=side * side)
    means = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return means.reshape(side, side)


def _take_over(heights: Array, x: float, y: float, previous: ElevationMap) -> None:
    """Put what an earlier scan measured where this one saw nothing."""
    rows = round((x - previous.x) / RESOLUTION) + np.arange(heights.shape[0])
    columns = round((y - previous.y) / RESOLUTION) + np.arange(heights.shape[1])
    here, there = overlap(previous, rows, columns)
    older = np.where(known_cells(previous)[there], heights_of(previous)[there], np.nan)
    heights[here] = np.where(np.isfinite(heights[here]), heights[here], older)


def _filled(heights: Array) -> Array:
    """Unknown cells grow inwards from the known ones, each the mean of its neighbours, then are smoothed."""
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
    """The mean over each cell's valid 3x3 neighbourhood; NaN where there is none."""
    total = _box_sum(np.where(valid, cells, 0.0))
    count = _box_sum(valid.astype(np.float64))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _box_sum(cells: Array) -> Array:
    padded = np.pad(cells, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    total: Array = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return total
