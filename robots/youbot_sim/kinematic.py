"""The quick backend: no dynamics. Joints are where the drives want them, and an object that is let go has fallen."""

from pathlib import Path

from robots.youbot_sim.drawing import draw
from robots.youbot_sim.drives import START, Drives
from robots.youbot_sim.kinematics import tip_in_world
from robots.youbot_sim.places import BOXES, OBJECT
from robots.youbot_sim.vocabulary import JointReadings, ObjectPlace


class KinematicManipulator:
    """Exact at any time; it needs no steps."""

    name = "kinematic"

    def __init__(self) -> None:
        self._base, self._arm, self._gripper = START["base"], START["arm"], START["gripper"]
        self._object = ObjectPlace.NOWHERE
        self._is_covered = False

    def follow(self, drives: Drives, now: float) -> None:
        """Take up the joints, and let the fingers close around the object, or let it go."""
        self._base, self._arm = drives.joints("base", now), drives.joints("arm", now)
        (gap,) = drives.joints("gripper", now)
        if self._object is ObjectPlace.OFFERED and gap <= OBJECT[0]:
            self._object = ObjectPlace.HELD
        elif self._object is ObjectPlace.HELD and gap > OBJECT[0]:
            self._object = self._below()
        is_between = self._object in (ObjectPlace.OFFERED, ObjectPlace.HELD)
        self._gripper = (max(gap, OBJECT[0]) if is_between else gap,)

    def measured(self) -> JointReadings:
        """As the drives have it."""
        return JointReadings(self._base, self._arm, self._gripper, self._object)

    def assume(self, readings: JointReadings) -> None:
        """Take it over as it is."""
        self._base, self._arm, self._gripper = readings.base, readings.arm, readings.gripper
        self._object = readings.object

    def offer(self) -> None:
        """Between the fingers."""
        self._object = ObjectPlace.OFFERED

    def cover(self, *, is_covered: bool) -> None:
        """Remember it."""
        self._is_covered = is_covered

    def picture(self, path: Path) -> Path:
        """A drawing from above and from the side, as SVG."""
        written = path.with_suffix(".svg")
        written.write_text(draw(self.measured(), is_covered=self._is_covered), encoding="utf-8")
        return written

    def close(self) -> None:
        """Nothing to free."""

    def _below(self) -> ObjectPlace:
        """Where something falls that is let go."""
        x, y, _ = tip_in_world(self._base, self._arm)
        for box in BOXES:
            is_closed = box.place is ObjectPlace.BOX_B and self._is_covered
            if box.holds(x, y) and not is_closed:
                return box.place
        return ObjectPlace.FLOOR
