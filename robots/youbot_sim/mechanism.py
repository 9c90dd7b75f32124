"""The interface of a simulated robot and its surroundings to its simulator module."""

from pathlib import Path
from typing import Protocol

from robots.youbot_sim.drives import Drives
from robots.youbot_sim.vocabulary import JointReadings


class MobileManipulator(Protocol):
    """A robot at place A, a box at B and one at C."""

    name: str

    def follow(self, drives: Drives, now: float) -> None:
        """Let time pass until *now*."""

    def measured(self) -> JointReadings:
        """The joints, and the object."""

    def assume(self, readings: JointReadings) -> None:
        """Take up a posture, at rest; with the object between the fingers, if it is held."""

    def offer(self) -> None:
        """A hand holds the object between the fingers."""

    def cover(self, *, is_covered: bool) -> None:
        """Put a lid on box B, or take it off."""

    def picture(self, path: Path) -> Path:
        """Draw robot and boxes; returns the path written, whose ending may differ."""

    def close(self) -> None:
        """Free what the simulator holds."""
