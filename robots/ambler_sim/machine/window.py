"""Physics in PyBullet's own window, for people with a screen. The camera walks along with the robot."""

import math
import time

import pybullet

from robots.ambler_sim.machine.physics import BulletPlant
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.vocabulary import Attitude, Pose, Posture
from robots.engine import Engine

OPTIONS = (
    "--width=1200 --height=800 --background_color_red=0.78 --background_color_green=0.85 --background_color_blue=0.92"
)
DISTANCE, SIDEWAYS, DOWN = 9.0, 50.0, -16.0
"""Of the camera: metres from the robot, and degrees to the robot's direction and to the horizon."""

BETWEEN_LOOKS = 0.04
"""Seconds between two moves of the camera."""


class BulletWindow(BulletPlant):
    """A physical plant that can be seen while it moves."""

    def __init__(self, terrain: Terrain, posture: Posture) -> None:
        self._looked_at = 0.0
        super().__init__(terrain, posture)
        for panel in (pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_MOUSE_PICKING):
            self._engine.configureDebugVisualizer(panel, 0)

    def connect(self, tick: float) -> Engine:
        """A physics world in a window; it is drawn by a thread of the engine's own."""
        return Engine(pybullet.GUI, tick, options=OPTIONS)

    def attitude(self) -> Attitude:
        """Position and inclination of the body; the camera goes there."""
        attitude = super().attitude()
        if (now := time.monotonic()) > self._looked_at + BETWEEN_LOOKS:
            self._looked_at = now
            self._look_at(attitude.pose)
        return attitude

    def _look_at(self, pose: Pose) -> None:
        """The engine's yaw is that of a camera that looks along y."""
        yaw = math.degrees(pose.heading) + 90 + SIDEWAYS
        self._engine.resetDebugVisualizerCamera(DISTANCE, yaw, DOWN, (pose.x, pose.y, pose.height - 0.8))
