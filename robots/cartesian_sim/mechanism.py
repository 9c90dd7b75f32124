"""The simulated mechanism: axes with rate limits, brakes and limit switches, and the clean part of
the wall.

It has no clock: time passes only in ``advance``.
"""

import math
from dataclasses import dataclass, field

POWER_UP = 0.15
"""Seconds between switching a motor on and its brake being open."""

OVERTRAVEL = 0.02
"""Metres between a limit switch and the hard stop behind it, at each end."""

TOUCHES = 0.9
"""The share of the tool's way out at which it touches the wall."""

APART = 0.004
"""The least distance (m) between two points of a stroke."""


@dataclass(frozen=True)
class Sensed:
    """The sensor values of an axis. *reading* is the distance from the axis's place at the
    start.
    """

    reading: float
    speed: float
    is_powered: bool
    at_low: bool
    at_high: bool


@dataclass
class Axis:
    """A linear axis between two limit switches, at 0 and at its length. Metres and seconds."""

    length: float
    fastest: float
    acceleration: float
    position: float
    speed: float = 0.0
    wanted: float = 0.0
    is_on: bool = False
    powered_for: float = 0.0
    began_at: float = field(init=False)

    def __post_init__(self) -> None:
        self.began_at = self.position

    @property
    def is_powered(self) -> bool:
        """Whether the brake is open."""
        return self.is_on and self.powered_for >= POWER_UP - 1e-9

    def advance(self, seconds: float) -> None:
        """Let time pass. The speed follows the wanted one within limits; brakes act at once."""
        self.powered_for = self.powered_for + seconds if self.is_on else 0.0
        if not self.is_powered:
            self.speed = 0.0
            return
        wanted = min(max(self.wanted, -self.fastest), self.fastest)
        change = self.acceleration * seconds
        before, self.speed = self.speed, self.speed + min(max(wanted - self.speed, -change), change)
        free = self.position + (before + self.speed) / 2 * seconds
        self.position = min(max(free, -OVERTRAVEL), self.length + OVERTRAVEL)
        if self.position != free:
            self.speed = 0.0

    def sensed(self) -> Sensed:
        """Return the sensor values."""
        at_low, at_high = self.position < 0.0, self.position > self.length
        return Sensed(self.position - self.began_at, self.speed, self.is_powered, at_low, at_high)


Stroke = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Scene:
    """The visible state of the robot."""

    x: float
    y: float
    tool: float
    strokes: tuple[Stroke, ...]
    """The wiped lines."""


class CleaningMechanism:
    """Two axes that carry a tool along a wall, and a third one that presses it to the wall."""

    def __init__(self) -> None:
        self.axes = {
            "x": Axis(2.0, fastest=0.8, acceleration=1.6, position=0.62),
            "y": Axis(1.2, fastest=0.8, acceleration=1.6, position=0.41),
            "tool": Axis(0.2, fastest=0.4, acceleration=1.6, position=0.05),
        }
        self._strokes: list[Stroke] = []

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        for axis in self.axes.values():
            axis.advance(seconds)
        tool = self.axes["tool"]
        if tool.position >= TOUCHES * tool.length:
            self._wipe((self.axes["x"].position, self.axes["y"].position))
        elif self._strokes and self._strokes[-1]:
            self._strokes.append(())  # the next stroke begins when the tool touches the wall again

    def scene(self) -> Scene:
        """Return the visible state."""
        x, y, tool = (axis.position for axis in self.axes.values())
        return Scene(x, y, tool, tuple(stroke for stroke in self._strokes if stroke))

    def _wipe(self, here: tuple[float, float]) -> None:
        """Extend the stroke. A point between two others on a straight line is left out."""
        stroke = self._strokes.pop() if self._strokes else ()
        if stroke and math.dist(stroke[-1], here) < APART:
            self._strokes.append(stroke)
            return
        if len(stroke) > 1 and _is_straight(stroke[-2], stroke[-1], here):
            stroke = stroke[:-1]
        self._strokes.append((*stroke, here))


def _is_straight(
    start: tuple[float, float], middle: tuple[float, float], end: tuple[float, float]
) -> bool:
    """Return whether the way through *middle* is as long as the direct way."""
    return math.dist(start, middle) + math.dist(middle, end) - math.dist(start, end) < 1e-5
