"""Messages of a navigator, which plans the turtle's way, and the tasks that use it.

The tests have a navigator; this folder has none. The tasks work in any environment with a pose.
"""

from dataclasses import dataclass
from math import hypot, remainder, tau

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import OnceTask, PeriodicTask, Status, parameter
from tca_module import Goal, Inform


@dataclass
class Target:
    """A goal pose in a frame of reference."""

    x: float
    y: float
    yaw: float = 0.0
    frame_id: str = "sheet"


MOVE_BASE = Goal("move base", Target)
"""Ends when the turtle has arrived; fails if it can't arrive."""

MOVE_BASE_SIMPLE = Inform("move base simple", Target)
"""The sender gets no reply."""


class MoveBase(OnceTask[TurtleEnvironment]):
    """Have the navigator bring the turtle to a pose. The task fails if the navigator's goal fails,
    and stops the goal when it is stopped itself.
    """

    goal_x: float = parameter(0.0, "X coordinate of the goal")
    goal_y: float = parameter(0.0, "Y coordinate of the goal")
    goal_yaw: float = parameter(0.0, "Where to look there, in radians")
    frame_id: str = parameter("sheet", "Frame of reference")

    def iterate(self) -> None:
        """Wait for the navigator."""
        self.task.goal(
            MOVE_BASE, Target(self.goal_x, self.goal_y, self.goal_yaw, self.frame_id)
        ).result()


class MoveGoal(PeriodicTask[TurtleEnvironment]):
    """Send the navigator a pose, and check here whether the turtle arrives."""

    goal_x: float = parameter(0.0, "X coordinate of the goal")
    goal_y: float = parameter(0.0, "Y coordinate of the goal")
    goal_yaw: float = parameter(0.0, "Where to look there, in radians")
    wait_completion: bool = parameter(True, "Whether to wait until the turtle is there")
    linear_threshold: float = parameter(0.2, "Distance within which it is there", minimum=0)
    angular_threshold: float = parameter(0.2, "Radians within which it looks there", minimum=0)
    resend_period: float = parameter(
        0.0, "Seconds after which the goal is sent again; 0: never", minimum=0
    )

    def initialise(self) -> None:
        """Send the goal."""
        self._send()

    def iterate(self) -> Status:
        """Compare the pose with the goal. Send the goal again if that is due."""
        pose = self.env.pose
        is_near = hypot(self.goal_x - pose.x, self.goal_y - pose.y) < self.linear_threshold
        is_turned = abs(remainder(self.goal_yaw - pose.theta, tau)) < self.angular_threshold
        if not self.wait_completion or (is_near and is_turned):
            return Status.COMPLETED
        if 0.0 < self.resend_period <= self.task.time() - self._sent_at:
            self._send()
        return Status.RUNNING

    def _send(self) -> None:
        self._sent_at = self.task.time()
        self.task.inform(MOVE_BASE_SIMPLE, Target(self.goal_x, self.goal_y, self.goal_yaw))
