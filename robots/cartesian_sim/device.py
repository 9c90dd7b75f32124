"""The simulated device that the joints drive."""

import time
from collections.abc import Callable

from robots.cartesian_sim.generated import DeviceBase, MotorOrder
from robots.cartesian_sim.mechanism import Axis, CleaningMechanism

LONGEST = 0.1
"""The longest time in seconds that a step simulates. A step that comes later simulates no more."""


class Device(DeviceBase):
    """The activities of the device. *clock* gives the device's time, whatever the simulation's
    period.
    """

    clock: Callable[[], float] = staticmethod(time.monotonic)

    def take_drive_x(self, value: MotorOrder) -> None:
        """Set the order of the motor of the x axis."""
        _drive(self.mechanism.axes["x"], value)

    def take_drive_y(self, value: MotorOrder) -> None:
        """Set the order of the motor of the y axis."""
        _drive(self.mechanism.axes["y"], value)

    def take_drive_tool(self, value: MotorOrder) -> None:
        """Set the order of the tool's motor."""
        _drive(self.mechanism.axes["tool"], value)

    def switch_on(self) -> None:
        """Begin with a dirty wall."""
        self.mechanism = CleaningMechanism()
        self._now = self.clock()

    def simulate(self) -> None:
        """Simulate the time since the last step, and publish the sensor values."""
        before, self._now = self._now, self.clock()
        self.mechanism.advance(min(self._now - before, LONGEST))
        axes = self.mechanism.axes
        self.sensed_x.set(axes["x"].sensed())
        self.sensed_y.set(axes["y"].sensed())
        self.sensed_tool.set(axes["tool"].sensed())
        self.scene.set(self.mechanism.scene())


def _drive(axis: Axis, wanted: MotorOrder) -> None:
    axis.is_on, axis.wanted = wanted.is_on, wanted.speed
