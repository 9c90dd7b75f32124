"""The cleaning robot in virtual time."""

from collections.abc import Callable

from robots.cartesian_sim.application import Components
from robots.cartesian_sim.joint import Joint
from robots.cartesian_sim.mechanism import Scene
from tca_behaviours.activities import Application, VirtualBaton


class VirtualRobot:
    """The robot's components, ticked by an application without threads."""

    def __init__(self) -> None:
        self.baton = VirtualBaton(lambda _activity: 0.0)
        self.parts = Components()
        self.parts.device.clock = self.baton.clock
        self.application = Application("cleaning robot", self.parts.all, baton=self.baton)
        self.joints: list[Joint] = [self.parts.x, self.parts.y, self.parts.tool]
        self.application.initialise()
        self.application.start()

    def run_until(self, holds: Callable[[], bool], within: float = 40.0) -> float:
        """Advance until a condition holds, and return the time. Fail if *within* seconds are over
        before.
        """
        end = self.baton.clock() + within
        while not holds():
            assert self.baton.clock() < end, self.states()
            self.baton.run(0.01)
        return self.baton.clock()

    def states(self) -> dict[str, str]:
        """Return the current state of each region."""
        return {
            f"{part.name}.{region.name}": region.current
            for part in self.parts.all
            for region in part.regions.values()
        }

    def positions(self) -> list[float]:
        """Return the true positions of the axes."""
        return [axis.position for axis in self.parts.device.mechanism.axes.values()]

    def scene(self) -> Scene:
        """Return the visible scene."""
        assert self.parts.device.scene.value is not None
        return self.parts.device.scene.value

    def command_joints(self, command: str) -> None:
        for joint in self.joints:
            joint.command.put(command)

    def make_ready(self) -> None:
        """Enable and reference all joints."""
        self.command_joints("enable")
        self.run_until(lambda: all(joint.enabling.is_in("enabled") for joint in self.joints))
        self.command_joints("reference")
        self.run_until(lambda: all(joint.referencing.is_in("referenced") for joint in self.joints))
