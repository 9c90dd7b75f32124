"""What a robot's tasks need to agree with other robots."""

from robots.turtle_sim.environment import TurtleEnvironment
from robots.turtle_sim.sync.link import StatusLink


class SyncEnvironment(TurtleEnvironment):
    """A turtle with partners, to which it is linked."""

    def __init__(self, link: StatusLink) -> None:
        super().__init__()
        self.link = link
