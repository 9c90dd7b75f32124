"""The interface of a simulated robot and its surroundings, and a function that makes one."""

import importlib
import importlib.util
from pathlib import Path
from typing import Literal, Protocol, get_args

from robots.youbot_sim.drives import Drives
from robots.youbot_sim.kinematic import KinematicManipulator
from robots.youbot_sim.vocabulary import JointReadings

Backend = Literal["auto", "pybullet", "kinematic"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)


class MobileManipulator(Protocol):
    """A robot at place A, a box at B and one at C."""

    name: str

    def follow(self, drives: Drives, now: float) -> None:
        """Let time pass until *now*."""

    def measured(self) -> JointReadings:
        """Return the joint values and the place of the object."""

    def assume(self, readings: JointReadings) -> None:
        """Set a posture at rest, with the object between the fingers if it is held."""

    def offer(self) -> None:
        """Hold an object between the fingers, as a user's hand does."""

    def cover(self, *, is_covered: bool) -> None:
        """Put a lid on box B, or take it off."""

    def picture(self, path: Path) -> Path:
        """Draw robot and boxes. Returns the path written, whose ending may differ."""

    def close(self) -> None:
        """Free the resources of the simulator."""


def make_robot(backend: Backend = "auto") -> MobileManipulator:
    """Make a robot at place A. "auto" is PyBullet if installed, else the kinematic backend."""
    is_installed = importlib.util.find_spec("pybullet") is not None
    if backend == "kinematic" or (backend == "auto" and not is_installed):
        return KinematicManipulator()
    physics = importlib.import_module("robots.youbot_sim.physics")
    robot: MobileManipulator = physics.BulletManipulator()
    return robot
