"""The task SetPen."""

from robots.turtle_sim.environment import TurtleEnvironment
from robots.turtle_sim.world import Pen
from tca_behaviours.missions import OnceTask, parameter


class SetPen(OnceTask[TurtleEnvironment]):
    """Change the pen, or lift it."""

    on: bool = parameter(True, "Whether the pen is down")
    r: int = parameter(0, "Red", minimum=0, maximum=255)
    g: int = parameter(0, "Green", minimum=0, maximum=255)
    b: int = parameter(0, "Blue", minimum=0, maximum=255)
    width: int = parameter(2, "Width of its lines", minimum=1, maximum=50)

    def iterate(self) -> None:
        """Have the turtle change its pen."""
        self.env.set_pen(self.task, Pen(self.r, self.g, self.b, self.width, self.on))
