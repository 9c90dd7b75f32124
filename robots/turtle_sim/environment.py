"""What the tasks of a turtle share: where it is, and what it can be told."""

import threading

from robots.turtle_sim.errors import TurtleError
from robots.turtle_sim.messages import CHANGE_PEN, CLEAR_SHEET, POSE, VELOCITY, Velocity
from robots.turtle_sim.world import Pen, Pose
from tca_behaviours.missions import Environment
from tca_module import Module, Sender, Task

PATIENCE = 10.0
"""Seconds within which the turtle must have done what takes no time."""


class TurtleEnvironment(Environment):
    """A turtle somewhere: its simulator, or another machine that understands the messages."""

    def __init__(self, patience: float = 5.0) -> None:
        """*patience*: seconds to wait until the turtle is heard of for the first time."""
        super().__init__()
        self._patience = patience
        self._heard = threading.Event()

    def attach(self, module: Module) -> None:
        """Have the server's module listen to the turtle."""

        @module.handles(POSE, resource="sensors")
        def listen(_: Task, pose: Pose) -> None:
            self._pose = pose
            self._heard.set()

    @property
    def pose(self) -> Pose:
        """Where the turtle is. Raises TurtleError if nothing is heard of it."""
        if not self._heard.wait(self._patience):
            raise TurtleError("the turtle has not told where it is: does its simulator run?")
        return self._pose

    def publish_velocity(self, sender: Sender, linear: float, angular: float) -> None:
        """Move and turn, until the next command or for a second."""
        sender.inform(VELOCITY, Velocity(linear, angular))

    def set_pen(self, sender: Sender, pen: Pen) -> None:
        """Take another pen."""
        sender.command(CHANGE_PEN, pen).result(PATIENCE)

    def clear(self, sender: Sender) -> None:
        """Wipe the sheet."""
        sender.command(CLEAR_SHEET).result(PATIENCE)
