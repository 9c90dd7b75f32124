"""The ground as bodies of the physics engine: rocks, and tiles around the robot.

The tiles are moved along as the robot walks.

The engine never frees the memory of a height field. So a tile is never removed. Its heights are
replaced instead.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
import pybullet

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.machine.terrain import MOST_ADDED, RESOLUTION, Terrain
from robots.ambler_sim.vocabulary import Rock
from robots.engine import Engine

TILE = 64
"""Cells on each side of a tile: 16 m."""

NEAR = 15.0
"""The radius (m) of ground around the robot. The range finder reaches 14 m."""

DEEPEST = 300.0
"""How far (m) ground may be above or below the start."""

AWAY = -1000
"""The row and column of spare tiles, far away from the robot."""

FRICTION = 1.0
UNSEEN = 64
"""The collision group of bodies that the scanner does not see."""

ROOTS = 1.0
"""The depth (m) of rocks in the ground."""

SOIL = (0.81, 0.67, 0.53, 1.0)
STONE = (0.45, 0.43, 0.41, 1.0)


class Tile(NamedTuple):
    """A piece of ground: the numbers of its body and of its height field."""

    body: int
    shape: int


class GroundBodies:
    """The ground of a physics world."""

    def __init__(self, engine: Engine, terrain: Terrain) -> None:
        self._engine, self._terrain = engine, terrain
        self._tiles: dict[tuple[int, int], Tile] = {}
        self._spare_tiles: list[Tile] = []
        self._covered: tuple[int, int, int, int] | None = None
        for rock in terrain.spec.rocks:
            self._make_rock(rock)
        self._added: deque[int] = deque()

    @property
    def tiles(self) -> frozenset[int]:
        """The numbers of the bodies that are ground."""
        return frozenset(tile.body for tile in self._tiles.values())

    def follow(self, x: float, y: float) -> None:
        """Lay tiles around this place of the robot, reusing those that are now far away."""
        size = TILE * RESOLUTION
        first, last = int((x - NEAR) // size), int((x + NEAR) // size)
        lowest, highest = int((y - NEAR) // size), int((y + NEAR) // size)
        if self._covered == (first, last, lowest, highest):
            return
        self._covered = first, last, lowest, highest
        near = {(i, j) for i in range(first, last + 1) for j in range(lowest, highest + 1)}
        for place in sorted(set(self._tiles) - near):
            self._retire(self._tiles.pop(place))
        for place in sorted(near - set(self._tiles)):
            self._cover(place)

    def add(self, rock: Rock) -> None:
        """Put a rock onto the ground. Beyond MOST_ADDED the oldest added rock is removed."""
        self._added.append(self._make_rock(rock))
        if len(self._added) > MOST_ADDED:
            self._engine.removeBody(self._added.popleft())

    def remake(self, x: float, y: float) -> None:
        """Lay new tiles around a point where the ground has changed."""
        size = TILE * RESOLUTION
        corners = {(int((x + i) // size), int((y + j) // size)) for i in (-1, 1) for j in (-1, 1)}
        for place in sorted(corners & set(self._tiles)):
            # If the old tile got new heights where it is, the feet would stay on the old heights.
            old_tile = self._tiles[place]
            self._cover(place)
            self._retire(old_tile)

    def _retire(self, tile: Tile) -> None:
        self._lay(tile, AWAY, AWAY)
        self._spare_tiles.append(tile)

    def _cover(self, place: tuple[int, int]) -> None:
        """Lay a spare or new tile at a place, with the heights of the ground there."""
        tile = self._spare_tiles.pop() if self._spare_tiles else self._make_tile()
        heights = self._terrain.lattice(place[0] * TILE, place[1] * TILE, TILE + 1, TILE + 1)
        self._height_field(heights, replaceHeightfieldIndex=tile.shape)
        self._lay(tile, *place)
        self._tiles[place] = tile

    def _make_tile(self) -> Tile:
        """Make a flat tile with one peak and one pit, as high and as deep as any ground may be.

        The engine searches for contacts only within the range of a tile's first heights.
        """
        heights = np.zeros((TILE + 1, TILE + 1))
        heights[0, 0], heights[-1, -1] = -DEEPEST, DEEPEST
        shape = self._height_field(heights)
        body: int = self._engine.createMultiBody(0, shape)
        self._engine.changeDynamics(body, -1, lateralFriction=FRICTION)
        self._engine.changeVisualShape(body, -1, textureUniqueId=-1, rgbaColor=SOIL)
        return Tile(body, shape)

    def _lay(self, tile: Tile, i: int, j: int) -> None:
        middle = ((i + 0.5) * TILE * RESOLUTION, (j + 0.5) * TILE * RESOLUTION, 0.0)
        self._engine.resetBasePositionAndOrientation(tile.body, middle, (0, 0, 0, 1))

    def _height_field(self, heights: Array, **options: int) -> int:
        number: int = self._engine.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD,
            meshScale=[RESOLUTION, RESOLUTION, 1],
            heightfieldData=heights.T.ravel().tolist(),
            numHeightfieldRows=TILE + 1,
            numHeightfieldColumns=TILE + 1,
            **options,
        )
        return number

    def _make_rock(self, rock: Rock) -> int:
        """Make an upright cylinder that does not move. Cameras see it and feet feel it."""
        height = rock.height + ROOTS
        shape = self._engine.createCollisionShape(
            pybullet.GEOM_CYLINDER, radius=rock.radius, height=height
        )
        look = self._engine.createVisualShape(
            pybullet.GEOM_CYLINDER, radius=rock.radius, length=height, rgbaColor=STONE
        )
        place = rock.x, rock.y, self._terrain.top(rock) - height / 2
        body: int = self._engine.createMultiBody(0, shape, look, basePosition=place)
        self._engine.setCollisionFilterGroupMask(body, -1, UNSEEN, -1)
        return body
