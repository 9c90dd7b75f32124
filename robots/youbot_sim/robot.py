"""How to get a robot: with physics where it can be had, else without."""

import importlib
import importlib.util
from typing import Literal

from robots.youbot_sim.kinematic import KinematicManipulator
from robots.youbot_sim.mechanism import MobileManipulator

Physics = Literal["auto", "pybullet", "kinematic"]


def make_robot(backend: Physics = "auto") -> MobileManipulator:
    """A robot at place A. "auto" takes PyBullet if it is installed, else the kinematic twin."""
    if backend == "kinematic" or (backend == "auto" and importlib.util.find_spec("pybullet") is None):
        return KinematicManipulator()
    physics = importlib.import_module("robots.youbot_sim.physics")
    robot: MobileManipulator = physics.BulletManipulator()
    return robot
