"""A navigator: a module of its own that plans the turtle's way. What it understands, and the tasks
that make use of it.

There is none in this folder; tests have one. The tasks fit any environment that knows a pose.
"""

from dataclasses import dataclass
from math import hypot, remainder, tau

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import OnceTask, PeriodicTask, Status, parameter
from tca_module import Goal, Inform


@dataclass
class Target:
    """A pose to come to, in a frame of reference."""

    x: float
    y: float
    yaw: float = 0.0
    frame_id: str = "sheet"


MOVE_BASE = Goal("move base", Target)
"""It ends when the turtle is there, and fails if it can't come there."""

MOVE_BASE_SIMPLE = Inform("move base simple", Target)
"""The sender hears no more of it."""


class MoveBase(OnceTask[TurtleEnvironment]):
    """Have the navigator bring the turtle to a pose. A failure there is one here, and a stop here
    is one there.
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
    """Tell the navigator a pose, and see for oneself whether the turtle gets there."""

    goal_x: float = parameter(0.0, "X coordinate of the goal")
    goal_y: float = parameter(0.0, "Y coordinate of the goal")
    goal_yaw: float = parameter(0.0, "Where to look there, in radians")
    wait_completion: bool = parameter(True, "Whether to wait until the turtle is there")
    linear_threshold: float = parameter(0.2, "Distance at which it is", minimum=0)
    angular_threshold: float = parameter(0.2, "Radians at which it looks there", minimum=0)
    resend_period: float = parameter(
        0.0, "Seconds after which the goal is told again; 0: never", minimum=0
    )

    def initialise(self) -> None:
        """Tell the goal."""
        self._send()

    def iterate(self) -> Status:
        """Compare where the turtle is; tell the goal again if it is time."""
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
