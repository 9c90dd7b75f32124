"""The environment of a turtle's tasks: the turtle's pose, and the commands to it."""

import threading

from robots.turtle_sim.errors import TurtleError
from robots.turtle_sim.messages import CHANGE_PEN, CLEAR_SHEET, POSE, VELOCITY, Velocity
from robots.turtle_sim.world import Pen, Pose
from tca_behaviours.missions import Environment
from tca_module import Module, Sender, Task

PATIENCE = 10.0
"""Seconds that the turtle gets for a command that takes no time."""


class TurtleEnvironment(Environment):
    """A turtle: a simulated one, or another machine that handles the same messages."""

    def __init__(self, patience: float = 5.0) -> None:
        """Wait up to *patience* seconds for the turtle's first pose."""
        super().__init__()
        self._patience = patience
        self._has_pose = threading.Event()

    def attach(self, module: Module) -> None:
        """Subscribe the server's module to the turtle's pose."""

        @module.handles(POSE, resource="sensors")
        def store_pose(_: Task, pose: Pose) -> None:
            self._pose = pose
            self._has_pose.set()

    @property
    def pose(self) -> Pose:
        """The turtle's newest pose. Raises TurtleError if none arrives in time."""
        if not self._has_pose.wait(self._patience):
            raise TurtleError("the turtle has not sent its pose: does its simulator run?")
        return self._pose

    def publish_velocity(self, sender: Sender, linear: float, angular: float) -> None:
        """Move and turn until the next command, for at most a second."""
        sender.inform(VELOCITY, Velocity(linear, angular))

    def set_pen(self, sender: Sender, pen: Pen) -> None:
        """Change the pen."""
        sender.command(CHANGE_PEN, pen).result(PATIENCE)

    def clear(self, sender: Sender) -> None:
        """Wipe the sheet."""
        sender.command(CLEAR_SHEET).result(PATIENCE)
