"""The device that the joints drive, simulated."""

import time
from collections.abc import Callable

from robots.cartesian_sim.generated import DeviceBase, MotorOrder
from robots.cartesian_sim.mechanism import Axis, CleaningMechanism

LONGEST = 0.1
"""Seconds that pass in one step at most, however late it comes."""


class Device(DeviceBase):
    """What the activities of Device do. Its time is that of a clock, whatever the period of the
    simulation is.
    """

    clock: Callable[[], float] = staticmethod(time.monotonic)

    def take_drive_x(self, value: MotorOrder) -> None:
        """MotorOrder the x axis."""
        _drive(self.mechanism.axes["x"], value)

    def take_drive_y(self, value: MotorOrder) -> None:
        """MotorOrder the y axis."""
        _drive(self.mechanism.axes["y"], value)

    def take_drive_tool(self, value: MotorOrder) -> None:
        """MotorOrder the axis of the tool."""
        _drive(self.mechanism.axes["tool"], value)

    def switch_on(self) -> None:
        """Begin with a dirty wall."""
        self.mechanism = CleaningMechanism()
        self._now = self.clock()

    def simulate(self) -> None:
        """Let the time pass since the last step, and tell what the sensors say."""
        before, self._now = self._now, self.clock()
        self.mechanism.advance(min(self._now - before, LONGEST))
        axes = self.mechanism.axes
        self.sensed_x.set(axes["x"].sensed())
        self.sensed_y.set(axes["y"].sensed())
        self.sensed_tool.set(axes["tool"].sensed())
        self.scene.set(self.mechanism.scene())


def _drive(axis: Axis, wanted: MotorOrder) -> None:
    axis.is_on, axis.wanted = wanted.is_on, wanted.speed
