"""The ground as bodies of the physics engine: tiles around the robot, which come and go as it walks, and rocks."""

from collections import deque

import pybullet

from robots.ambler_sim.machine.terrain import MOST_ADDED, RESOLUTION, Terrain
from robots.ambler_sim.vocabulary import Rock

TILE = 64
"""Cells on each side of a tile: 16 m."""

NEAR = 15.0
"""Metres around the robot that have ground: the range finder reaches 14 m."""

FRICTION = 1.0
UNSEEN = 64
"""The collision group of what the scanner looks through."""

ROOTS = 1.0
"""How deep (m) rocks are in the ground."""

SOIL = (0.81, 0.67, 0.53, 1.0)
STONE = (0.45, 0.43, 0.41, 1.0)


class GroundBodies:
    """The ground of a physics world."""

    def __init__(self, world: int, terrain: Terrain) -> None:
        self._world, self._terrain = world, terrain
        self._tiles: dict[tuple[int, int], int] = {}
        self._around: tuple[int, int, int, int] | None = None
        self.rocks = [self._make_rock(rock) for rock in terrain.spec.rocks]
        self._added: deque[int] = deque()

    @property
    def tiles(self) -> frozenset[int]:
        """The numbers of the bodies that are ground."""
        return frozenset(self._tiles.values())

    def follow(self, x: float, y: float) -> None:
        """The robot is here: make the tiles around it, and remove those that are far away."""
        size = TILE * RESOLUTION
        first, last = int((x - NEAR) // size), int((x + NEAR) // size)
        lowest, highest = int((y - NEAR) // size), int((y + NEAR) // size)
        if self._around == (first, last, lowest, highest):
            return
        self._around = first, last, lowest, highest
        near = {(i, j) for i in range(first, last + 1) for j in range(lowest, highest + 1)}
        for place in set(self._tiles) - near:
            pybullet.removeBody(self._tiles.pop(place), physicsClientId=self._world)
        for place in sorted(near - set(self._tiles)):
            self._tiles[place] = self._make_tile(*place)

    def add(self, rock: Rock) -> None:
        """Put a rock onto the ground; the oldest ones that were added go."""
        self._added.append(self._make_rock(rock))
        self.rocks.append(self._added[-1])
        if len(self._added) > MOST_ADDED:
            oldest = self._added.popleft()
            self.rocks.remove(oldest)
            pybullet.removeBody(oldest, physicsClientId=self._world)

    def remake(self, x: float, y: float) -> None:
        """The ground around a point has changed."""
        size = TILE * RESOLUTION
        corners = {(int((x + i) // size), int((y + j) // size)) for i in (-1, 1) for j in (-1, 1)}
        for place in sorted(corners & set(self._tiles)):
            pybullet.removeBody(self._tiles[place], physicsClientId=self._world)
            self._tiles[place] = self._make_tile(*place)

    def _make_tile(self, i: int, j: int) -> int:
        """A height field. The engine puts the middle of its height range at z = 0, hence the offset."""
        heights = self._terrain.lattice(i * TILE, j * TILE, TILE + 1, TILE + 1)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD,
            meshScale=[RESOLUTION, RESOLUTION, 1],
            heightfieldData=heights.T.ravel().tolist(),
            numHeightfieldRows=TILE + 1,
            numHeightfieldColumns=TILE + 1,
            physicsClientId=self._world,
        )
        middle = ((i + 0.5) * TILE * RESOLUTION, (j + 0.5) * TILE * RESOLUTION, (heights.max() + heights.min()) / 2)
        tile: int = pybullet.createMultiBody(0, shape, basePosition=middle, physicsClientId=self._world)
        pybullet.changeDynamics(tile, -1, lateralFriction=FRICTION, physicsClientId=self._world)
        pybullet.changeVisualShape(tile, -1, textureUniqueId=-1, rgbaColor=SOIL, physicsClientId=self._world)
        return tile

    def _make_rock(self, rock: Rock) -> int:
        """An upright cylinder that does not move, seen by cameras and felt by feet."""
        size, height = {"radius": rock.radius, "physicsClientId": self._world}, rock.height + ROOTS
        shape = pybullet.createCollisionShape(pybullet.GEOM_CYLINDER, height=height, **size)
        look = pybullet.createVisualShape(pybullet.GEOM_CYLINDER, length=height, rgbaColor=STONE, **size)
        place = rock.x, rock.y, self._terrain.top(rock) - height / 2
        body: int = pybullet.createMultiBody(0, shape, look, basePosition=place, physicsClientId=self._world)
        group = 1 if rock.seen else UNSEEN
        pybullet.setCollisionFilterGroupMask(body, -1, group, -1, physicsClientId=self._world)
        return body
