"""The true ground: seeded smooth hills. Planners never see this; they see the map built from scans."""

import math
import random
from dataclasses import dataclass, field

import numpy as np

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.vocabulary import Rock, TerrainSpec

RESOLUTION = 0.25
BEHIND_START = 6.0
PATH_HALF_WIDTH = 3.5
WAVES = 14
STANDS_ON = 0.15
"""A foot that is no further (m) below the top of a rock stands on it; a lower one is beside it."""

ROCK_RADIUS = (0.2, 0.3)


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights (rows along x, columns along y) on a grid whose first cell is at *x0*, *y0*."""

    spec: TerrainSpec
    x0: float
    y0: float
    heights: Array = field(repr=False)

    def height(self, x: float, y: float) -> float:
        """The ground height (m) at a point; beyond the edge that of the edge."""
        return float(self.heights_at(np.array([x]), np.array([y]))[0])

    def heights_at(self, x: Array, y: Array) -> Array:
        """The ground heights at many points, bilinear between the grid's."""
        rows, columns = self.heights.shape
        u = np.clip((x - self.x0) / RESOLUTION, 0, rows - 1.001)
        v = np.clip((y - self.y0) / RESOLUTION, 0, columns - 1.001)
        i, j = u.astype(np.intp), v.astype(np.intp)
        u, v = u - i, v - j
        near = self.heights[i, j] * (1 - v) + self.heights[i, j + 1] * v
        far = self.heights[i + 1, j] * (1 - v) + self.heights[i + 1, j + 1] * v
        between: Array = near * (1 - u) + far * u
        return between

    def top(self, rock: Rock) -> float:
        """The height of a rock's highest point in the world."""
        return self.height(rock.x, rock.y) + rock.height

    def under(self, places: Array) -> Array:
        """The height under these points (n, 3): of the ground, or of the top of a rock that they are not below."""
        heights = self.heights_at(places[:, 0], places[:, 1])
        for rock in self.spec.rocks:
            top = self.top(rock)
            over = np.hypot(places[:, 0] - rock.x, places[:, 1] - rock.y) <= rock.radius
            heights = np.where(over & (places[:, 2] >= top - STANDS_ON), np.maximum(heights, top), heights)
        return heights


def make_terrain(spec: TerrainSpec) -> Terrain:
    """Hills from a sum of waves, scaled so that the steepest gradient near the line y = 0 is exactly *spec.slope*."""
    x0, y0 = -BEHIND_START, -spec.width / 2
    x = _every_resolution(x0, spec.length)
    y = _every_resolution(y0, spec.width)
    heights = _waves(random.Random(spec.seed), x, y)  # noqa: S311 - hills need no secrets
    band = heights[:, np.abs(y) <= PATH_HALF_WIDTH]
    return Terrain(spec, x0, y0, heights * (spec.slope / max(steepest(band), 1e-9)))


def scattered_rocks(seed: int, count: int, metres: float, height: tuple[float, float]) -> tuple[Rock, ...]:
    """*count* rocks where legs swing: one in each of as many equal parts of a straight path of *metres*, left and right
    in turn. Their heights are within these bounds.
    """
    seeded = random.Random(seed)  # noqa: S311 - stones need no secrets
    rocks = []
    for number in range(count):
        x = metres * (number + seeded.uniform(0.3, 0.7)) / count
        y = seeded.uniform(1.2, 1.7) * (1 if number % 2 == 0 else -1)
        rocks.append(Rock(x, y, seeded.uniform(*ROCK_RADIUS), seeded.uniform(*height)))
    return tuple(rocks)


def steepest(heights: Array) -> float:
    """The largest rise per metre between neighbours of a height grid, both directions taken together."""
    dx, dy = np.gradient(heights, RESOLUTION)
    return float(np.hypot(dx, dy).max())


def _every_resolution(first: float, length: float) -> Array:
    cells = np.arange(round(length / RESOLUTION) + 1, dtype=np.float64)
    return np.add(first, RESOLUTION * cells, dtype=np.float64)


def _waves(seeded: random.Random, x: Array, y: Array) -> Array:
    """Waves of 1.5 to 14 m length; the long ones are the highest, as on real ground."""
    heights = np.zeros((len(x), len(y)))
    for number in range(WAVES):
        length = 14.0 * (1.5 / 14.0) ** (number / (WAVES - 1))
        direction, phase = seeded.uniform(0, math.pi), seeded.uniform(0, math.tau)
        along = math.cos(direction) * x[:, None] + math.sin(direction) * y[None, :]
        heights += length**1.5 * np.sin(math.tau * along / length + phase)
    return heights
