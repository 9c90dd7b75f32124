"""Reading and making elevation maps: what the robot believes about the ground."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.vocabulary import ElevationMap, Obstacle, Window

Cells = NDArray[np.intp]
Mask = NDArray[np.bool_]


def make_map(x: float, y: float, resolution: float, heights: Array, known: Mask) -> ElevationMap:
    """A map whose first cell has its centre at *x*, *y*."""
    rows, columns = heights.shape
    return ElevationMap(x, y, resolution, rows, columns, heights.astype("<f4").tobytes(), known.astype("u1").tobytes())


def heights_of(ground: ElevationMap) -> Array:
    """The cells' heights (rows, columns); NaN where nothing is known nearby."""
    cells = np.frombuffer(ground.heights, dtype="<f4").reshape(ground.rows, ground.columns)
    return cells.astype(np.float64)


def known_cells(ground: ElevationMap) -> Mask:
    """Which cells were measured; the others are filled in from their neighbours or NaN."""
    return np.frombuffer(ground.known, dtype="u1").reshape(ground.rows, ground.columns).astype(bool)


def cells_at(ground: ElevationMap, x: Array, y: Array) -> tuple[Cells, Cells, Mask]:
    """Row and column (clipped) of each point, and whether the point is on the map."""
    row = np.rint((x - ground.x) / ground.resolution).astype(np.intp)
    column = np.rint((y - ground.y) / ground.resolution).astype(np.intp)
    inside = (row >= 0) & (row < ground.rows) & (column >= 0) & (column < ground.columns)
    return row.clip(0, ground.rows - 1), column.clip(0, ground.columns - 1), inside


def heights_along(ground: ElevationMap, x: Array, y: Array) -> Array:
    """The height of the cell below each point; NaN off the map."""
    row, column, inside = cells_at(ground, x, y)
    return np.where(inside, heights_of(ground)[row, column], np.nan)


def height_at(ground: ElevationMap, x: float, y: float) -> float:
    """The height of one cell; NaN where it is unknown."""
    return float(heights_along(ground, np.array([x]), np.array([y]))[0])


def unknown_map(window: Window, resolution: float = 0.1) -> ElevationMap:
    """A map of which nothing is known."""
    cell = make_map(window.x, window.y, resolution, np.array([[np.nan]]), np.zeros((1, 1), dtype=bool))
    return cut(cell, window)


def cut(ground: ElevationMap, window: Window) -> ElevationMap:
    """The part of a map in a window; cells beyond its border are NaN."""
    side = 2 * math.ceil(window.reach / ground.resolution) + 1
    row = round((window.x - window.reach - ground.x) / ground.resolution)
    column = round((window.y - window.reach - ground.y) / ground.resolution)
    heights, known = np.full((side, side), np.nan), np.zeros((side, side), dtype=bool)
    here, there = overlap(ground, row + np.arange(side), column + np.arange(side))
    heights[here], known[here] = heights_of(ground)[there], known_cells(ground)[there]
    x, y = ground.x + row * ground.resolution, ground.y + column * ground.resolution
    return make_map(x, y, ground.resolution, heights, known)


def overlap(ground: ElevationMap, rows: Cells, columns: Cells) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Of a grid whose cells have these rows and columns of a map: the cells that are on the map, here and there."""
    on_rows, on_columns = (rows >= 0) & (rows < ground.rows), (columns >= 0) & (columns < ground.columns)
    return np.ix_(on_rows, on_columns), np.ix_(rows[on_rows], columns[on_columns])


def with_obstacles(ground: ElevationMap, obstacles: Iterable[Obstacle]) -> ElevationMap:
    """The map with what was felt: walls are infinitely high; of places where no foot should stand nothing is known."""
    heights = heights_of(ground).copy()
    rows, columns = np.indices(heights.shape)
    for each in obstacles:
        away = np.hypot(ground.x + ground.resolution * rows - each.x, ground.y + ground.resolution * columns - each.y)
        heights[away <= each.radius] = math.inf if each.is_wall else math.nan
    return make_map(ground.x, ground.y, ground.resolution, heights, known_cells(ground))


def windows(ground: ElevationMap, x: float, y: float, reach: float) -> tuple[slice, slice]:
    """The rows and columns of the cells within *reach* of a point, cut off at the border of the map."""
    cells = math.ceil(reach / ground.resolution)
    row = round((x - ground.x) / ground.resolution)
    column = round((y - ground.y) / ground.resolution)
    return slice(max(row - cells, 0), max(row + cells + 1, 0)), slice(
        max(column - cells, 0), max(column + cells + 1, 0)
    )
