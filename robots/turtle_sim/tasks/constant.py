"""The task Constant."""

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import PeriodicTask, Status, parameter


class Constant(PeriodicTask[TurtleEnvironment]):
    """Move and turn at a constant velocity, for some time."""

    duration: float = parameter(1.0, "Seconds", minimum=0)
    linear: float = parameter(0.0, "Units a second, ahead")
    angular: float = parameter(0.0, "Radians a second, to the left")

    def initialise(self) -> None:
        """Record the start time."""
        self._began = self.task.time()

    def iterate(self) -> Status:
        """Repeat the command, because the turtle forgets it after a second."""
        if self.task.time() - self._began >= self.duration:
            return Status.COMPLETED
        self.env.publish_velocity(self.task, self.linear, self.angular)
        return Status.RUNNING

    def terminate(self) -> None:
        """Stop the turtle."""
        self.env.publish_velocity(self.task, 0.0, 0.0)
