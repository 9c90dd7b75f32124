"""The environment of tasks that coordinate with other robots."""

from robots.turtle_sim.environment import TurtleEnvironment
from robots.turtle_sim.sync.link import StatusLink


class SyncEnvironment(TurtleEnvironment):
    """A turtle with a link to its partners."""

    def __init__(self, link: StatusLink) -> None:
        super().__init__()
        self.link = link
