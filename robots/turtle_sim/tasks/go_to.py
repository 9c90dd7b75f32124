"""The task GoTo."""

from math import atan2, copysign, hypot, pi, remainder, tau

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import PeriodicTask, Status, parameter


class GoTo(PeriodicTask[TurtleEnvironment]):
    """Reach a desired destination."""

    goal_x: float = parameter(0.0, "X coordinate of destination", minimum=0, maximum=11)
    goal_y: float = parameter(0.0, "Y coordinate of destination", minimum=0, maximum=11)
    k_v: float = parameter(1.0, "Gain for velocity control", minimum=0)
    k_alpha: float = parameter(1.0, "Gain for angular control", minimum=0)
    max_velocity: float = parameter(1.0, "Max allowed velocity", minimum=0)
    dist_threshold: float = parameter(
        0.1, "Distance at which the target is considered reached", minimum=0
    )

    def iterate(self) -> Status:
        """Turn on the spot until the goal is roughly ahead; then drive there."""
        pose = self.env.pose
        distance = hypot(self.goal_y - pose.y, self.goal_x - pose.x)
        if distance < self.dist_threshold:
            return Status.COMPLETED
        self.report(f"{distance:.0f} to go")
        alpha = remainder(atan2(self.goal_y - pose.y, self.goal_x - pose.x) - pose.theta, tau)
        if abs(alpha) > pi / 6:
            self.env.publish_velocity(self.task, 0.0, copysign(pi / 6, alpha))
        else:
            self.env.publish_velocity(
                self.task, min(self.k_v * distance, self.max_velocity), self.k_alpha * alpha
            )
        return Status.RUNNING

    def terminate(self) -> None:
        """Stop the turtle."""
        self.env.publish_velocity(self.task, 0.0, 0.0)
