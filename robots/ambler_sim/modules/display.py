"""The robot's picture, as a variable that is updated after footsteps, or also during moves."""

import time
from collections.abc import Callable
from contextlib import suppress

from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.messages import ROBOT_PICTURE
from tca_module import Sender, TcaError

BETWEEN_PICTURES = 1.0
"""The least number of seconds between two pictures. Drawing one takes some milliseconds."""

WHILE_MOVING = 0.2
"""The least number of seconds between two pictures during a move, in real time and in robot
time.
"""


class Display:
    """Draws a robot after footsteps or, with *while_moving*, also during moves."""

    def __init__(
        self, robot: Robot, *, while_moving: bool, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._robot, self._while_moving, self._clock = robot, while_moving, clock
        self._due = self._due_in_robot_time = 0.0

    def tick(self, sender: Sender) -> None:
        """Draw at a tick of a move, if a picture is due."""
        if self._while_moving and self._robot.time >= self._due_in_robot_time:
            self._due_in_robot_time = self._robot.time + WHILE_MOVING
            self._show(sender, WHILE_MOVING)

    def after_footstep(self, sender: Sender) -> None:
        """Draw after a footstep, if a picture is due."""
        self._show(sender, BETWEEN_PICTURES)

    def _show(self, sender: Sender, pause: float) -> None:
        if (now := self._clock()) >= self._due:
            self._due = now + pause
            # A picture must not fail a move: the task may be killed, or central disconnected.
            with suppress(TcaError):
                sender.set_variable(ROBOT_PICTURE, self._robot.drawing(), wait=False)
