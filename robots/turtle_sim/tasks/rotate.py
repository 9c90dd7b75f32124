"""The task Rotate."""

from math import copysign, remainder, tau

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import PeriodicTask, Status, parameter


class Rotate(PeriodicTask[TurtleEnvironment]):
    """Turn on the spot, by an angle that may be more than a whole turn."""

    angle: float = parameter(tau / 4, "Radians, to the left")
    velocity: float = parameter(0.5, "Radians a second", minimum=0.01, maximum=10)
    threshold: float = parameter(
        0.02, "Radians at which the angle is considered reached", minimum=0
    )

    def initialise(self) -> None:
        """Store the remaining angle and the heading."""
        self._remaining, self._last_theta = self.angle, self.env.pose.theta

    def iterate(self) -> Status:
        """Continue the turn, slower towards its end."""
        theta = self.env.pose.theta
        self._remaining -= remainder(theta - self._last_theta, tau)
        self._last_theta = theta
        if abs(self._remaining) < self.threshold:
            return Status.COMPLETED
        self.env.publish_velocity(
            self.task, 0.0, copysign(min(self.velocity, abs(self._remaining)), self._remaining)
        )
        return Status.RUNNING

    def terminate(self) -> None:
        """Stop the turtle."""
        self.env.publish_velocity(self.task, 0.0, 0.0)
