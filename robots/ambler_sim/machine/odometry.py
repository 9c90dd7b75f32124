"""Dead reckoning: the body's pose from a compass and the standing legs, assumed not to slip."""

import math

import numpy as np

from robots.ambler_sim.geometry import Array, feet_of, rigid_motion
from robots.ambler_sim.vocabulary import Pose
from robots.plane import world_place

COMPASS_NOISE = math.radians(0.5)
COMPASS_WEIGHT = 0.1
"""The weight of a compass reading: enough against slow drift, and too little to show its noise."""


class Odometry:
    """The estimated pose of the body at the last fix, and its joints (6, 3) at that time."""

    def __init__(self, pose: Pose, joints: Array) -> None:
        self._pose = pose
        self._feet = feet_of(joints)

    def estimate(self, joints: Array, airborne: set[int]) -> Pose:
        """Return the present pose, from the motion of the standing feet relative to the body."""
        standing = [leg for leg in range(len(joints)) if leg not in airborne]
        before, now = self._feet[standing], feet_of(joints)[standing]
        # The motion of the body, in its own frame at the last fix.
        turn, way = rigid_motion(now[:, :2], before[:, :2])
        rise = float((before[:, 2] - now[:, 2]).mean())
        dx, dy = world_place(0.0, 0.0, self._pose.heading, float(way[0]), float(way[1]))
        return Pose(
            self._pose.x + dx,
            self._pose.y + dy,
            self._pose.heading + turn,
            self._pose.height + rise,
        )

    def fix(self, joints: Array, airborne: set[int], compass: float | None = None) -> None:
        """Make the present estimate the new fix, corrected by the *compass* if given."""
        pose = self.estimate(joints, airborne)
        heading = pose.heading
        if compass is not None:
            heading += COMPASS_WEIGHT * math.remainder(compass - heading, math.tau)
        self._pose = Pose(pose.x, pose.y, heading, pose.height)
        self._feet = feet_of(joints)


def compass(true_heading: float, seed: int, number: int) -> float:
    """Return a compass reading (rad) after the footstep with this number."""
    return true_heading + float(np.random.default_rng((seed, 7, number)).normal(0.0, COMPASS_NOISE))
