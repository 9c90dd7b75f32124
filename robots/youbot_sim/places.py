"""Where things are: the poses that the robot knows by name, the boxes, the object."""

from dataclasses import dataclass

from robots.plane import seen_from
from robots.youbot_sim.kinematics import Grip, joints_for
from robots.youbot_sim.vocabulary import Group, Joints, ObjectPlace

OBJECT = (0.040, 0.040, 0.060)
"""Its sizes: as wide as the fingers are apart that hold it."""

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
"""What each group of joints can be told to go to."""


@dataclass(frozen=True, slots=True)
class DropBox:
    """A box without a top, on the floor; *size* is that of its square bottom, inside."""

    place: ObjectPlace
    x: float
    y: float
    heading: float
    size: float = 0.20
    height: float = 0.20
    wall: float = 0.01

    def holds(self, x: float, y: float) -> bool:
        """Whether something that is let go above this point falls into it."""
        return max(map(abs, seen_from(self.x, self.y, self.heading, x, y))) < self.size / 2


BOXES = (
    DropBox(ObjectPlace.BOX_B, 2.885, 0.905, 0.4),
    DropBox(ObjectPlace.BOX_C, 1.468, -1.928, -0.9),
)
