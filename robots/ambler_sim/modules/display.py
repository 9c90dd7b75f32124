"""The robot's picture for whoever looks: a shared variable, drawn now and then."""

import time
from collections.abc import Callable
from contextlib import suppress

from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.messages import ROBOT_PICTURE
from tca_module import Sender, TcaError

BETWEEN_PICTURES = 1.0
"""Seconds between two pictures, at least; drawing one takes some milliseconds."""

WHILE_MOVING = 0.2
"""The same for a robot that is shown while it moves: in its time as well as in ours."""


class Display:
    """Draws a robot after footsteps or, *while_moving*, all the time."""

    def __init__(
        self, robot: Robot, *, while_moving: bool, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._robot, self._while_moving, self._clock = robot, while_moving, clock
        self._due = self._due_in_its_time = 0.0

    def tick(self, sender: Sender) -> None:
        """A move goes on."""
        if self._while_moving and self._robot.time >= self._due_in_its_time:
            self._due_in_its_time = self._robot.time + WHILE_MOVING
            self._show(sender, WHILE_MOVING)

    def made_a_footstep(self, sender: Sender) -> None:
        """The robot stands."""
        self._show(sender, BETWEEN_PICTURES)

    def _show(self, sender: Sender, pause: float) -> None:
        if (now := self._clock()) >= self._due:
            self._due = now + pause
            with suppress(
                TcaError
            ):  # no picture is worth a move: it may have been killed, or central be away
                sender.set_variable(ROBOT_PICTURE, self._robot.drawing(), wait=False)
