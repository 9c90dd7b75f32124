"""The true ground: unbounded, from a seed. Planners never see it; they see the map built from
scans.

Both simulators use the heights of one lattice, bilinear in between. Only the part near the robot is
cached, so memory does not grow.
"""

import math
import random
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.machine.relief import Relief
from robots.ambler_sim.vocabulary import Rock, TerrainSpec

Cells = NDArray[np.intp]

RESOLUTION = 0.25
CELLS = 192
"""Cells on each side of the cached part of the lattice: 48 m."""

STANDS_ON = 0.15
"""A foot at most this far (m) below the top of a rock stands on it; a lower one is beside it."""

ROCK_RADIUS = (0.2, 0.3)
MOST_ADDED = 20
"""The number of rocks, and of holes, that are kept; older ones lie behind the robot."""

HOLE_RADIUS, HOLE_DEPTH = 0.6, 0.25
"""The radius and depth (m) of ground that falls in around a foot. Further out the hole is less
deep.
"""

STEEPNESS = {"flat": 0.0, "rolling": 0.1}
"""The steepest rise per run of the kinds of ground that have a limit of their own."""


class Terrain:
    """The ground of a walk."""

    def __init__(self, spec: TerrainSpec) -> None:
        self.spec = spec
        self._relief = Relief(
            spec.kind, spec.seed, min(spec.slope, STEEPNESS.get(spec.kind, spec.slope))
        )
        self._added: deque[Rock] = deque(maxlen=MOST_ADDED)
        self._holes = deque(spec.holes, maxlen=MOST_ADDED)
        self._tops: dict[Rock, float] = {}  #: also of rocks outside the cached ground
        self._cache(-CELLS // 2, -CELLS // 2)

    @property
    def present(self) -> TerrainSpec:
        """The specification of the present ground, without the rocks added later."""
        return replace(self.spec, holes=tuple(self._holes))

    @property
    def rocks(self) -> tuple[Rock, ...]:
        """All rocks on the ground, also those added later."""
        return (*self.spec.rocks, *self._added)

    def lattice(self, row: int, column: int, rows: int, columns: int) -> Array:
        """Return the heights of a part of the lattice, rows along x, from this row and column
        on.
        """
        return self._lattice_heights(
            np.arange(row, row + rows)[:, None], np.arange(column, column + columns)[None, :]
        )

    def height(self, x: float, y: float) -> float:
        """Return the ground height (m) at a point."""
        return float(self.heights_at(np.array([x]), np.array([y]))[0])

    def heights_at(self, x: Array, y: Array) -> Array:
        """Return the ground heights at many points, bilinear between those of the lattice."""
        u, v = x / RESOLUTION, y / RESOLUTION
        i: Cells = np.floor(u).astype(np.intp)
        j: Cells = np.floor(v).astype(np.intp)
        u, v = u - i, v - j
        if self._is_cached(i, j):
            a, b, cells = i - self._row, j - self._column, self._cached
            corners = cells[a, b], cells[a, b + 1], cells[a + 1, b], cells[a + 1, b + 1]
        else:
            compute = self._lattice_heights
            corners = compute(i, j), compute(i, j + 1), compute(i + 1, j), compute(i + 1, j + 1)
        near = corners[0] * (1 - v) + corners[1] * v
        far = corners[2] * (1 - v) + corners[3] * v
        between: Array = near * (1 - u) + far * u
        return between

    def gradient_at(self, x: float, y: float) -> float:
        """Return the rise per run of the ground around a point."""
        step = RESOLUTION
        east, west, north, south = self.heights_at(
            np.array([x + step, x - step, x, x]), np.array([y, y, y + step, y - step])
        )
        return math.hypot(east - west, north - south) / (2 * step)

    @property
    def has_soft_ground(self) -> bool:
        """Whether the ground is soft anywhere."""
        return self.spec.kind == "soft"

    def firmness_at(self, x: Array, y: Array) -> Array:
        """Return the factor of the feet's stiffness at these points: 1 on firm ground."""
        return self._relief.firmness(x, y)

    def add(self, rock: Rock) -> None:
        """Put a rock onto the ground."""
        self._added.append(rock)

    def give_way(self, x: float, y: float) -> None:
        """Let the ground around a point fall in."""
        self._holes.append((x, y))
        self._cache(self._row, self._column)

    def top(self, rock: Rock) -> float:
        """Return the height of a rock's highest point in the world."""
        if rock not in self._tops:
            self._tops[rock] = self.height(rock.x, rock.y) + rock.height
        return self._tops[rock]

    def under(self, places: Array) -> Array:
        """Return the height under these points (n, 3): of the ground, or of a rock's top below
        them.
        """
        heights = self.heights_at(places[:, 0], places[:, 1])
        for rock in self.rocks:
            away = np.hypot(places[:, 0] - rock.x, places[:, 1] - rock.y)
            if (away <= rock.radius).any():
                top = self.top(rock)
                over = (away <= rock.radius) & (places[:, 2] >= top - STANDS_ON)
                heights = np.where(over, np.maximum(heights, top), heights)
        return heights

    def _cache(self, row: int, column: int) -> None:
        """Cache the part of the lattice from this row and column on."""
        self._row, self._column = row, column
        self._cached = self.lattice(row, column, CELLS, CELLS)

    def _lattice_heights(self, i: Cells, j: Cells) -> Array:
        """Return the heights of these rows and columns of the lattice, with the holes."""
        x: Array = RESOLUTION * i.astype(np.float64)
        y: Array = RESOLUTION * j.astype(np.float64)
        heights = self._relief.heights(x, y)
        for middle_x, middle_y in self._holes:
            inside = (1.5 - 1.5 * np.hypot(x - middle_x, y - middle_y) / HOLE_RADIUS).clip(0.0, 1.0)
            heights = heights - HOLE_DEPTH * inside
        return heights

    def _is_cached(self, i: Cells, j: Cells) -> bool:
        """Return whether these cells are in the cached part. Move that part if necessary."""
        low_i, high_i, low_j, high_j = int(i.min()), int(i.max()), int(j.min()), int(j.max())
        last = CELLS - 2  # a cell's corners are in the next row and column, too
        if (
            self._row <= low_i <= high_i <= self._row + last
            and self._column <= low_j <= high_j <= self._column + last
        ):
            return True
        if max(high_i - low_i, high_j - low_j) > CELLS // 2:
            return False
        self._cache((low_i + high_i - CELLS) // 2, (low_j + high_j - CELLS) // 2)
        return True


def scattered_rocks(
    seed: int, count: int, metres: float, height: tuple[float, float]
) -> tuple[Rock, ...]:
    """Place *count* rocks where legs swing. Their heights are within the bounds *height*.

    A straight path of *metres* is divided into *count* equal parts. Each part gets one rock, left
    and right in turn.
    """
    seeded = random.Random(seed)  # noqa: S311 - stones need no secrets
    rocks = []
    for number in range(count):
        x = metres * (number + seeded.uniform(0.3, 0.7)) / count
        y = seeded.uniform(1.2, 1.7) * (1 if number % 2 == 0 else -1)
        rocks.append(Rock(x, y, seeded.uniform(*ROCK_RADIUS), seeded.uniform(*height)))
    return tuple(rocks)
