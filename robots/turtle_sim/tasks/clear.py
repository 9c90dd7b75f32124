"""The task Clear."""

from dataclasses import dataclass

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import OnceTask, parameter


@dataclass
class Header:
    """An example of a parameter that is more than a number or a text."""

    frame_id: str = ""
    stamp: float = 0.0


class Clear(OnceTask[TurtleEnvironment]):
    """Wipe the sheet."""

    header: Header | None = parameter(None, "Origin of the request")

    def iterate(self) -> None:
        """Have the turtle's sheet wiped."""
        if self.header is not None:
            self.report(f"got an extra header, frame_id={self.header.frame_id}")
        self.env.clear(self.task)
