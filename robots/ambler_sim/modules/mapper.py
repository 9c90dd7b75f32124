"""The local terrain mapper: builds maps from images on demand, with obstacles that legs felt."""

from collections import deque

from robots.ambler_sim.messages import ELEVATION_MAP, FELT, FORGET_FELT, IMAGES, UPDATE_MAP
from robots.ambler_sim.planning.elevation import (
    build_elevation_map,
    cut,
    points_of,
    unknown_map,
    with_obstacles,
)
from robots.ambler_sim.vocabulary import ElevationMap, Obstacle, Window
from tca_module import Module, Task

MOST_REMEMBERED = 30
"""The number of obstacles remembered; older ones lie behind the robot."""

mapper = Module("mapper")


class GroundMemory:
    """The map so far, the number of its last image, and the obstacles that legs felt."""

    def __init__(self) -> None:
        self.ground: ElevationMap | None = None
        self.number = 0
        self.obstacles: deque[Obstacle] = deque(maxlen=MOST_REMEMBERED)


memory = GroundMemory()


@mapper.handles(UPDATE_MAP)
def update_map(task: Task) -> None:
    """Add the new images to the map."""
    for image in task.query(IMAGES, memory.number):
        memory.ground = build_elevation_map(points_of(image.scan), image.scan.stance, memory.ground)
        memory.number = image.number


@mapper.handles(ELEVATION_MAP)
def elevation_map(task: Task, window: Window) -> ElevationMap:
    """Return the ground in a window, NaN where it is unknown."""
    update_map(task)
    if memory.ground is None:
        return unknown_map(window)
    return with_obstacles(cut(memory.ground, window), memory.obstacles)


@mapper.handles(FELT)
def add_obstacle(_: Task, obstacle: Obstacle) -> None:
    """Remember an obstacle that a leg met and the scanner does not see."""
    memory.obstacles.append(obstacle)


@mapper.handles(FORGET_FELT)
def forget_obstacles(_: Task) -> None:
    """Forget the felt obstacles. They leave no way, so some must be in the wrong place."""
    memory.obstacles.clear()


if __name__ == "__main__":
    mapper.run()
