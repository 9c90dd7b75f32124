"""The interface of a simulated robot and its surroundings, and how to get one: with physics where
it can be had.
"""

import importlib
import importlib.util
from pathlib import Path
from typing import Literal, Protocol, get_args

from robots.youbot_sim.drives import Drives
from robots.youbot_sim.kinematic import KinematicManipulator
from robots.youbot_sim.vocabulary import JointReadings

Physics = Literal["auto", "pybullet", "kinematic"]
BACKENDS: tuple[Physics, ...] = get_args(Physics)


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


def make_robot(backend: Physics = "auto") -> MobileManipulator:
    """A robot at place A. "auto" takes PyBullet if it is installed, else the kinematic twin."""
    if backend == "kinematic" or (
        backend == "auto" and importlib.util.find_spec("pybullet") is None
    ):
        return KinematicManipulator()
    physics = importlib.import_module("robots.youbot_sim.physics")
    robot: MobileManipulator = physics.BulletManipulator()
    return robot
