"""The task WaitForROI."""

from math import hypot

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import PeriodicTask, Status, parameter


class WaitForROI(PeriodicTask[TurtleEnvironment]):
    """Wait until the turtle is in a region of interest: a circle."""

    roi_x: float = parameter(0.0, "X coordinate of its centre")
    roi_y: float = parameter(0.0, "Y coordinate of its centre")
    roi_radius: float = parameter(1.0, "Its radius", minimum=0)

    def iterate(self) -> Status:
        """Check the turtle's pose."""
        pose = self.env.pose
        is_inside = hypot(pose.x - self.roi_x, pose.y - self.roi_y) < self.roi_radius
        return Status.COMPLETED if is_inside else Status.RUNNING
