"""Dead reckoning: where the body is, from the legs that stand (they do not slip, it is believed)
and a compass.
"""

import math

import numpy as np

from robots.ambler_sim.geometry import Array, carried, feet_of
from robots.ambler_sim.vocabulary import Pose
from robots.plane import placed

COMPASS_NOISE = math.radians(0.5)
COMPASS_WEIGHT = 0.1
"""Of one reading against all that was reckoned before: slow creep in heading is corrected, noise is
smoothed.
"""


class Odometry:
    """The estimated pose of the body at the last fix, and the joints (6, 3) that it had there."""

    def __init__(self, pose: Pose, joints: Array) -> None:
        self._pose = pose
        self._feet = feet_of(joints)

    def estimate(self, joints: Array, airborne: set[int]) -> Pose:
        """The pose now, by how the standing feet have moved relative to the body since the last
        fix.
        """
        standing = [leg for leg in range(len(joints)) if leg not in airborne]
        then, now = self._feet[standing], feet_of(joints)[standing]
        turn, way = carried(
            now[:, :2], then[:, :2]
        )  # of the body, in its own frame at the last fix
        rise = float((then[:, 2] - now[:, 2]).mean())
        dx, dy = placed(0.0, 0.0, self._pose.heading, float(way[0]), float(way[1]))
        return Pose(
            self._pose.x + dx,
            self._pose.y + dy,
            self._pose.heading + turn,
            self._pose.height + rise,
        )

    def fix(self, joints: Array, airborne: set[int], compass: float | None = None) -> None:
        """Go on from the present estimate, corrected by what the *compass* says."""
        pose = self.estimate(joints, airborne)
        heading = pose.heading
        if compass is not None:
            heading += COMPASS_WEIGHT * math.remainder(compass - heading, math.tau)
        self._pose = Pose(pose.x, pose.y, heading, pose.height)
        self._feet = feet_of(joints)


def compass(true_heading: float, seed: int, number: int) -> float:
    """A reading (rad) after the footstep with this number."""
    return true_heading + float(np.random.default_rng((seed, 7, number)).normal(0.0, COMPASS_NOISE))
