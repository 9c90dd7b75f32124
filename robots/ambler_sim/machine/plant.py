"""The interface of a simulated mechanism to a controller: joints to drive, sensors to read."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from robots.ambler_sim.geometry import BODY_HEIGHT, Array, joints_of, to_body
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.planning.gait import standard_feet
from robots.ambler_sim.vocabulary import Attitude, Foot, Pose, Posture, Rock


class Plant(Protocol):
    """A mechanism with 18 driven joints, on its ground. Arrays (6, 3) are angle, reach, drop per
    leg.
    """

    name: str
    tick: float
    _terrain: Terrain

    def drive(self, joints: Array, rates: Array) -> None:
        """Command joint positions and speeds, and let one tick pass."""

    def joints(self) -> Array:
        """Return the joint values that the encoders measure."""

    def loads(self) -> Array:
        """Return the vertical force (N) of the ground on each foot, (6,)."""

    def pushes(self) -> Array:
        """Return the horizontal force (N) on each foot, (6,)."""

    def bumps(self) -> Array:
        """Return the force (N) on each leg's links except its foot, and on the body, (7,)."""

    def attitude(self) -> Attitude:
        """Position and inclination of the body."""

    def cast(self, origin: Array, directions: Array, limit: float) -> Array:
        """Return the distance to the ground along each unit direction; NaN beyond *limit*
        metres.
        """

    def add_rock(self, rock: Rock) -> None:
        """Put a rock onto the ground. The scanner does not see the rock, but the robot collides
        with it.
        """
        self._terrain.add(rock)

    def give_way(self, x: float, y: float) -> None:
        """Let the ground around a point fall in, and with it the foot that stands there."""
        self._terrain.give_way(x, y)

    def photograph(
        self,
        path: Path,  # noqa: ARG002
        trail: Sequence[Foot],  # noqa: ARG002
        size: tuple[int, int],  # noqa: ARG002
    ) -> bool:
        """Write a PNG file of robot, ground and footprints. Returns False without a camera."""
        return False

    def close(self) -> None:
        """Free the resources of the simulator."""


def standing_posture(terrain: Terrain, start: Pose) -> Posture:
    """Return a level posture around *start*, all feet on the ground in the standard
    configuration.
    """
    flat = np.array([[foot.x, foot.y, 0.0] for foot in standard_feet(start, 0.0)])
    flat[:, 2] = terrain.heights_at(flat[:, 0], flat[:, 1])
    height = float(flat[:, 2].mean()) + BODY_HEIGHT
    pose = Pose(start.x, start.y, start.heading, height)
    return make_posture(Attitude(pose), joints_of(to_body(pose, flat)))


def make_posture(attitude: Attitude, joints: Array) -> Posture:
    """Attitude and joints as plain data."""
    return Posture(
        attitude, tuple((float(angle), float(reach), float(drop)) for angle, reach, drop in joints)
    )


def rotation_matrix(attitude: Attitude) -> Array:
    """Body to world: first roll about x, then pitch about y, then heading about z."""
    angles = attitude.roll, attitude.pitch, attitude.pose.heading
    (cr, sr), (cp, sp), (ch, sh) = ((np.cos(angle), np.sin(angle)) for angle in angles)
    return np.array(
        [
            [ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr],
            [sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
