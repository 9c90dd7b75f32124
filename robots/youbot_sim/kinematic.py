"""The quick backend, without dynamics: joints follow the drives exactly, released objects fall at
once.
"""

from dataclasses import replace
from pathlib import Path

from robots.youbot_sim.drawing import draw
from robots.youbot_sim.drives import START, Drives
from robots.youbot_sim.kinematics import tip_in_world
from robots.youbot_sim.places import BOX_B, BOXES, OBJECT
from robots.youbot_sim.vocabulary import GROUPS, JointReadings, Joints, ObjectPlace


class KinematicManipulator:
    """A manipulator without physics. Its joints are where the drives want them at any time."""

    name = "kinematic"

    def __init__(self) -> None:
        self._readings = START
        self._is_covered = False

    def follow(self, drives: Drives, now: float) -> None:
        """Set the joints, and let the fingers grip or release the object."""
        base, arm, (gap,) = (drives.joints(group, now) for group in GROUPS)
        place, width = self._readings.object, OBJECT[0]
        if place is ObjectPlace.OFFERED and gap <= width:
            place = ObjectPlace.HELD
        elif place is ObjectPlace.HELD and gap > width:
            place = self._landing_place(base, arm)
        if place in (ObjectPlace.OFFERED, ObjectPlace.HELD):
            gap = max(gap, width)
        self._readings = JointReadings(base, arm, (gap,), place)

    def measured(self) -> JointReadings:
        """Return the joints as set by the drives, and the object."""
        return self._readings

    def assume(self, readings: JointReadings) -> None:
        """Set joints and object."""
        self._readings = readings

    def offer(self) -> None:
        """Put the object between the fingers."""
        self._readings = replace(self._readings, object=ObjectPlace.OFFERED)

    def cover(self, *, is_covered: bool) -> None:
        """Store whether box B is covered."""
        self._is_covered = is_covered

    def picture(self, path: Path) -> Path:
        """Draw the robot from above and from the side, as SVG."""
        written = path.with_suffix(".svg")
        written.write_text(draw(self._readings, is_covered=self._is_covered), encoding="utf-8")
        return written

    def close(self) -> None:
        """Nothing to free."""

    def _landing_place(self, base: Joints, arm: Joints) -> ObjectPlace:
        """Return the place to which a released object falls."""
        x, y, _ = tip_in_world(base, arm)
        for box in BOXES:
            if box.holds(x, y) and not (box is BOX_B and self._is_covered):
                return box.place
        return ObjectPlace.FLOOR
