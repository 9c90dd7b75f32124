"""The task Wait."""

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import OnceTask, parameter


class Wait(OnceTask[TurtleEnvironment]):
    """Do nothing for some time."""

    duration: float = parameter(1.0, "Seconds to wait", minimum=0)

    def iterate(self) -> None:
        """Sleep."""
        self.sleep(self.duration)
