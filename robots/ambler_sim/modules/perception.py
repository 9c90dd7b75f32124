"""Perception: keeps an elevation map, and looks again when the robot has come some way since the last scan."""

import math

from robots.ambler_sim.messages import ELEVATION_MAP, SCAN
from robots.ambler_sim.planning.mapping import build_elevation_map, points_of
from robots.ambler_sim.vocabulary import ElevationMap, Pose, Stance
from tca_module import Module, Task

FRESH = 1.4
"""Metres that a map is good for: it reaches some metres further than any foothold that is planned within these."""

perception = Module("perception")


class GroundMemory:
    """The map so far, and where the robot was when it was last brought up to date."""

    ground: ElevationMap | None = None
    seen_from: Pose | None = None

    def is_fresh(self, pose: Pose) -> bool:
        """Whether the map is good enough to plan from *pose*."""
        seen = self.seen_from
        return seen is not None and math.hypot(pose.x - seen.x, pose.y - seen.y) < FRESH


memory = GroundMemory()


@perception.handles(ELEVATION_MAP)
def elevation_map(task: Task, stance: Stance) -> ElevationMap:
    """The ground around *stance*."""
    if memory.ground is None or not memory.is_fresh(stance.pose):
        scan = task.query(SCAN)
        memory.ground = build_elevation_map(points_of(scan), scan.stance, memory.ground)
        memory.seen_from = scan.stance.pose
    return memory.ground


if __name__ == "__main__":
    perception.run()
