"""The true ground: unbounded, from a seed. Planners never see it; they see the map built from
scans.

Heights are those of a lattice, bilinear in between, in both simulators. What is near the robot is
kept; nothing grows.
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
"""On each side of the part of the lattice that is kept: 48 m."""

STANDS_ON = 0.15
"""A foot that is no further (m) below the top of a rock stands on it; a lower one is beside it."""

ROCK_RADIUS = (0.2, 0.3)
MOST_ADDED = 20
"""Rocks and holes: older ones are behind."""

HOLE_RADIUS, HOLE_DEPTH = 0.6, 0.25
"""Of ground that gives way (m): it falls in around the foot, by less and less further out."""

STEEPNESS = {"flat": 0.0, "rolling": 0.1}
"""Rise per run, at most, of the kinds that don't have the slope that is asked for."""


class Terrain:
    """The ground of a walk."""

    def __init__(self, spec: TerrainSpec) -> None:
        self.spec = spec
        self._relief = Relief(
            spec.kind, spec.seed, min(spec.slope, STEEPNESS.get(spec.kind, spec.slope))
        )
        self._added: deque[Rock] = deque(maxlen=MOST_ADDED)
        self._holes = deque(spec.holes, maxlen=MOST_ADDED)
        self._tops: dict[Rock, float] = {}  #: far ones, too, of which no ground is kept
        self._keep(-CELLS // 2, -CELLS // 2)

    @property
    def present(self) -> TerrainSpec:
        """The ground as it now is, but for rocks that were added."""
        return replace(self.spec, holes=tuple(self._holes))

    @property
    def rocks(self) -> tuple[Rock, ...]:
        """The rocks on the ground, those that were added since too."""
        return (*self.spec.rocks, *self._added)

    def lattice(self, row: int, column: int, rows: int, columns: int) -> Array:
        """The heights of a part of the lattice (rows along x, columns along y) that begins at this
        row and column.
        """
        return self._computed(
            np.arange(row, row + rows)[:, None], np.arange(column, column + columns)[None, :]
        )

    def height(self, x: float, y: float) -> float:
        """The ground height (m) at a point."""
        return float(self.heights_at(np.array([x]), np.array([y]))[0])

    def heights_at(self, x: Array, y: Array) -> Array:
        """The ground heights at many points, bilinear between the lattice's."""
        u, v = x / RESOLUTION, y / RESOLUTION
        i: Cells = np.floor(u).astype(np.intp)
        j: Cells = np.floor(v).astype(np.intp)
        u, v = u - i, v - j
        if self._keeps(i, j):
            a, b, kept = i - self._row, j - self._column, self._kept
            corners = kept[a, b], kept[a, b + 1], kept[a + 1, b], kept[a + 1, b + 1]
        else:
            compute = self._computed
            corners = compute(i, j), compute(i, j + 1), compute(i + 1, j), compute(i + 1, j + 1)
        near = corners[0] * (1 - v) + corners[1] * v
        far = corners[2] * (1 - v) + corners[3] * v
        between: Array = near * (1 - u) + far * u
        return between

    def gradient_at(self, x: float, y: float) -> float:
        """The rise per run of the ground around a point."""
        step = RESOLUTION
        east, west, north, south = self.heights_at(
            np.array([x + step, x - step, x, x]), np.array([y, y, y + step, y - step])
        )
        return math.hypot(east - west, north - south) / (2 * step)

    @property
    def has_soft_ground(self) -> bool:
        """Whether the ground is soft anywhere."""
        return self.spec.kind == "soft"

    def softness_at(self, x: Array, y: Array) -> Array:
        """The factor of the feet's stiffness at these points: 1 on firm ground."""
        return self._relief.softness(x, y)

    def add(self, rock: Rock) -> None:
        """Put a rock onto the ground."""
        self._added.append(rock)

    def give_way(self, x: float, y: float) -> None:
        """The ground around a point falls in."""
        self._holes.append((x, y))
        self._keep(self._row, self._column)

    def top(self, rock: Rock) -> float:
        """The height of a rock's highest point in the world."""
        if rock not in self._tops:
            self._tops[rock] = self.height(rock.x, rock.y) + rock.height
        return self._tops[rock]

    def under(self, places: Array) -> Array:
        """The height under these points (n, 3): of the ground, or of the top of a rock that they
        are not below.
        """
        heights = self.heights_at(places[:, 0], places[:, 1])
        for rock in self.rocks:
            away = np.hypot(places[:, 0] - rock.x, places[:, 1] - rock.y)
            if (away <= rock.radius).any():
                top = self.top(rock)
                over = (away <= rock.radius) & (places[:, 2] >= top - STANDS_ON)
                heights = np.where(over, np.maximum(heights, top), heights)
        return heights

    def _keep(self, row: int, column: int) -> None:
        """Keep the part of the lattice that begins there."""
        self._row, self._column = row, column
        self._kept = self.lattice(row, column, CELLS, CELLS)

    def _computed(self, i: Cells, j: Cells) -> Array:
        """The heights of these rows and columns of the lattice, with the holes."""
        x: Array = RESOLUTION * i.astype(np.float64)
        y: Array = RESOLUTION * j.astype(np.float64)
        heights = self._relief.heights(x, y)
        for middle_x, middle_y in self._holes:
            inside = (1.5 - 1.5 * np.hypot(x - middle_x, y - middle_y) / HOLE_RADIUS).clip(0.0, 1.0)
            heights = heights - HOLE_DEPTH * inside
        return heights

    def _keeps(self, i: Cells, j: Cells) -> bool:
        """Whether the cells of these rows and columns are in the part that is kept, which moves if
        need be.
        """
        low_i, high_i, low_j, high_j = int(i.min()), int(i.max()), int(j.min()), int(j.max())
        last = CELLS - 2  # a cell's corners are in the next row and column, too
        if (
            self._row <= low_i <= high_i <= self._row + last
            and self._column <= low_j <= high_j <= self._column + last
        ):
            return True
        if max(high_i - low_i, high_j - low_j) > CELLS // 2:
            return False
        self._keep((low_i + high_i - CELLS) // 2, (low_j + high_j - CELLS) // 2)
        return True


def scattered_rocks(
    seed: int, count: int, metres: float, height: tuple[float, float]
) -> tuple[Rock, ...]:
    """*count* rocks where legs swing: one in each of as many equal parts of a straight path of
    *metres*, left and right in turn. Their heights are within these bounds.
    """
    seeded = random.Random(seed)  # noqa: S311 - stones need no secrets
    rocks = []
    for number in range(count):
        x = metres * (number + seeded.uniform(0.3, 0.7)) / count
        y = seeded.uniform(1.2, 1.7) * (1 if number % 2 == 0 else -1)
        rocks.append(Rock(x, y, seeded.uniform(*ROCK_RADIUS), seeded.uniform(*height)))
    return tuple(rocks)
