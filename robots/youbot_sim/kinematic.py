"""The quick backend: no dynamics. Joints are where the drives want them, and an object that is let
go has fallen.
"""

from dataclasses import replace
from pathlib import Path

from robots.youbot_sim.drawing import draw
from robots.youbot_sim.drives import START, Drives
from robots.youbot_sim.kinematics import tip_in_world
from robots.youbot_sim.places import BOXES, OBJECT
from robots.youbot_sim.vocabulary import GROUPS, JointReadings, Joints, ObjectPlace


class KinematicManipulator:
    """Exact at any time; it needs no steps."""

    name = "kinematic"

    def __init__(self) -> None:
        self._readings = START
        self._is_covered = False

    def follow(self, drives: Drives, now: float) -> None:
        """Take up the joints, and let the fingers close around the object, or let it go."""
        base, arm, (gap,) = (drives.joints(group, now) for group in GROUPS)
        thing = self._readings.object
        if thing is ObjectPlace.OFFERED and gap <= OBJECT[0]:
            thing = ObjectPlace.HELD
        elif thing is ObjectPlace.HELD and gap > OBJECT[0]:
            thing = self._below(base, arm)
        is_between = thing in (ObjectPlace.OFFERED, ObjectPlace.HELD)
        self._readings = JointReadings(
            base, arm, (max(gap, OBJECT[0]) if is_between else gap,), thing
        )

    def measured(self) -> JointReadings:
        """As the drives have it."""
        return self._readings

    def assume(self, readings: JointReadings) -> None:
        """Take it over as it is."""
        self._readings = readings

    def offer(self) -> None:
        """Between the fingers."""
        self._readings = replace(self._readings, object=ObjectPlace.OFFERED)

    def cover(self, *, is_covered: bool) -> None:
        """Remember it."""
        self._is_covered = is_covered

    def picture(self, path: Path) -> Path:
        """A drawing from above and from the side, as SVG."""
        written = path.with_suffix(".svg")
        written.write_text(draw(self._readings, is_covered=self._is_covered), encoding="utf-8")
        return written

    def close(self) -> None:
        """Nothing to free."""

    def _below(self, base: Joints, arm: Joints) -> ObjectPlace:
        """Where something falls that is let go."""
        x, y, _ = tip_in_world(base, arm)
        for box in BOXES:
            is_closed = box.place is ObjectPlace.BOX_B and self._is_covered
            if box.holds(x, y) and not is_closed:
                return box.place
        return ObjectPlace.FLOOR
