"""A joint: it is enabled, finds its reference at the lower switch, and moves to positions or at
speeds.
"""

import math

from robots.cartesian_sim.generated import JointBase, JointTarget, MotorOrder
from robots.cartesian_sim.mechanism import Sensed

SEEKING = 0.15
"""The greatest speed (m/s) without a reference: slow enough to stop between a limit switch and the
hard stop behind it.
"""

LEAVING = 0.01
"""The speed (m/s) away from the switch."""

DECELERATION = 1.0
"""The planned deceleration, less than the motor's, so that the joint does not overshoot."""

LAG = 0.06
"""Seconds by which the real speed lags behind the wanted one."""

EXACT = 0.0005
"""The distance (m) from a target at which it is reached."""

STILL = 0.005
"""The speed (m/s) up to which a joint stands still."""


class Joint(JointBase):
    """The activities of a joint."""

    # --- ports ------------------------------------------------------------------------------------

    def take_sensed(self, value: Sensed) -> None:
        """Store the sensor values, and publish the position."""
        data = self.data
        data.reading, data.measured_speed = value.reading, value.speed
        data.at_low, data.at_high = value.at_low, value.at_high
        data.is_powered = value.is_powered
        self.position.set(self._position())

    def take_command(self, value: str) -> None:
        """Post a command (enable, disable, reference, stop) as an event."""
        self.post(value)

    def take_target(self, value: JointTarget) -> None:
        """Move to a position within the range."""
        self.data.target = min(max(value.position, 0.0), self.data.length)
        self.data.speed = abs(value.speed)
        self.post("move")

    def take_jog(self, value: float) -> None:
        """Move at a speed until the range ends."""
        self.data.speed = value
        self.post("jog")

    # --- limits of range --------------------------------------------------------------------------

    def is_at_low(self) -> bool:
        """Return whether the lower switch is closed."""
        return self.data.at_low

    def is_at_high(self) -> bool:
        """Return whether the upper switch is closed."""
        return self.data.at_high

    def is_in_range(self) -> bool:
        """Return whether both switches are open."""
        return not (self.data.at_low or self.data.at_high)

    # --- axis referencing -------------------------------------------------------------------------

    def seek_switch(self) -> None:
        """Move down to the switch."""
        self._drive(-SEEKING)

    def leave_switch(self) -> None:
        """Move up slowly until the switch opens."""
        self._drive(LEAVING)

    def set_zero(self) -> None:
        """Set 0 to the reading at which the switch has opened."""
        self.data.zero = self.data.reading

    # --- movement enabling ------------------------------------------------------------------------

    def power_off(self) -> None:
        """Switch the motor off, which closes the brake."""
        self.data.is_on = False
        self._drive(0.0)

    def power_on(self) -> None:
        """Switch the motor on; its brake opens somewhat later."""
        self.data.is_on = True
        self._drive(0.0)

    def has_power(self) -> bool:
        """Return whether the brake is open."""
        return self.data.is_powered

    # --- movement control -------------------------------------------------------------------------

    def approach(self) -> None:
        """Move towards the target."""
        left = self.data.target - self._position()
        self._drive(math.copysign(min(self.data.speed, _safe_speed(abs(left))), left))

    def keep_speed(self) -> None:
        """Move at the wanted speed, but slowly near the end of the range or without a reference."""
        data, fastest = self.data, SEEKING
        if self.referencing.is_in("referenced"):
            left = data.length - self._position() if data.speed > 0 else self._position()
            fastest = max(_safe_speed(max(left, 0.0)), LEAVING)
        self._drive(math.copysign(min(abs(data.speed), fastest), data.speed))

    def halt(self) -> None:
        """Stop."""
        self._drive(0.0)

    def may_jog(self) -> bool:
        """Return whether there is room ahead and the joint does not search for its reference."""
        at_end = (self.data.at_low and self.goes_down()) or (self.data.at_high and self.goes_up())
        return not (at_end or self.referencing.is_in("searching"))

    def goes_down(self) -> bool:
        """Return whether the wanted speed leads to the lower switch."""
        return self.data.speed < 0

    def goes_up(self) -> bool:
        """Return whether the wanted speed leads to the upper switch."""
        return self.data.speed > 0

    def has_arrived(self) -> bool:
        """Return whether the joint stands at its target."""
        return (
            abs(self.data.target - self._position()) <= EXACT
            and abs(self.data.measured_speed) <= 2 * STILL
        )

    def is_still(self) -> bool:
        """Return whether the axis has stopped."""
        return abs(self.data.measured_speed) <= STILL

    # --- shared by the regions --------------------------------------------------------------------

    def _position(self) -> float:
        return self.data.reading - self.data.zero

    def _drive(self, speed: float) -> None:
        self.drive.set(MotorOrder(self.data.is_on, speed))


def _safe_speed(left: float) -> float:
    """Return the speed from which a joint stops within *left* metres."""
    return min(math.sqrt(2 * DECELERATION * left), left / LAG)
