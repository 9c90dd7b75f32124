"""The named poses of the robot, the boxes, and the object's size."""

from dataclasses import dataclass

from robots.plane import seen_from
from robots.youbot_sim.kinematics import Grip, joints_for
from robots.youbot_sim.vocabulary import Group, Joints, ObjectPlace

OBJECT = (0.040, 0.040, 0.060)
"""The size of the object (m). Its width is the gap of the fingers that hold it."""

POSES: dict[Group, dict[str, Joints]] = {
    "base": {"A": (0.0, 0.0, 0.0), "B": (2.4, 0.7, 0.4), "C": (1.5, -1.4, -0.9)},
    "arm": {
        "home": joints_for(Grip(0.0, 0.32, 0.50, 1.0)),
        "box B": joints_for(Grip(0.0, 0.36, 0.30, 2.2)),
        "box C": joints_for(Grip(-1.0, 0.42, 0.30, 1.9)),
        "tucked": (0.0, -1.10, 2.50, -1.75, 0.0),
    },
    "gripper": {"open": (0.053,), "closed": (0.030,)},
}
"""The poses that each group of joints can be sent to."""


@dataclass(frozen=True, slots=True)
class DropBox:
    """A box without a top, on the floor. *size* is the inner side of its square bottom."""

    place: ObjectPlace
    x: float
    y: float
    heading: float
    size: float = 0.20
    height: float = 0.20
    wall: float = 0.01

    def holds(self, x: float, y: float) -> bool:
        """Return whether an object released above this point falls into the box."""
        return max(map(abs, seen_from(self.x, self.y, self.heading, x, y))) < self.size / 2

    @property
    def side(self) -> float:
        """The outer side of the bottom."""
        return self.size + 2 * self.wall


BOX_B = DropBox(ObjectPlace.BOX_B, 2.885, 0.905, 0.4)
BOXES = (BOX_B, DropBox(ObjectPlace.BOX_C, 1.468, -1.928, -0.9))
