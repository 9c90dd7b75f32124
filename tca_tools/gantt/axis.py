"""A time axis: the places of times, round ticks, and their labels."""

from dataclasses import dataclass
from math import ceil, floor, log10

_LONG_STEPS = (60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800, 43200, 86400)
"""Round steps above 30 s, in seconds; longer ones are whole days."""


@dataclass(frozen=True)
class Scale:
    """The places of times in a plot. *zooms* are the factors by which it can be widened."""

    width: float
    start: float
    end: float
    zooms: tuple[int, ...] = (1,)

    @property
    def min_width(self) -> float:
        """The smallest visible length, in pixels of the plot before zooming."""
        return 1.0 / self.zooms[-1]

    @property
    def min_time(self) -> float:
        """The smallest visible length, in seconds."""
        return self.min_width * (self.end - self.start) / self.width

    def x(self, time: float) -> float:
        """Return the place of *time* in pixels; a time outside the plot is at its edge."""
        time, span = min(max(time, self.start), self.end), self.end - self.start
        return self.width * ((time - self.start) / span) if span > 0 else 0.0

    def zoom_for(self, needed: float, width: float) -> int | None:
        """Return the least zoom that makes *width* wider than *needed*; None if none does."""
        return next((zoom for zoom in self.zooms if width * zoom > needed), None)


def ticks(start: float, end: float, at_most: int) -> list[tuple[float, str]]:
    """Return round times between *start* and *end* with their labels: about *at_most* of them."""
    step = _step((end - start) / max(at_most, 1))
    if step <= 0:
        return [(start, _label(start, 1.0))]
    first, last = ceil(start / step - 1e-9), floor(end / step + 1e-9)
    return [(number * step, _label(number * step, step)) for number in range(first, last + 1)]


def _step(shortest: float) -> float:
    """Return the shortest round step of at least *shortest* seconds."""
    if shortest <= 0:
        return 0.0
    if shortest > 30:
        days = 86400 * ceil(shortest / 86400)
        return next((step for step in _LONG_STEPS if step >= shortest), days)
    power = 10.0 ** floor(log10(shortest))
    nice = (factor * power for factor in (1, 2, 5, 10))
    step = next((step for step in nice if step >= shortest * (1 - 1e-9)), 10 * power)
    return 30.0 if step == 50 else step


def _label(time: float, step: float) -> str:
    """Return the label of a time: ``0.25 s``, ``12 s``, ``3:30`` (minutes), ``1:05:00`` (hours)."""
    if step < 30:
        decimals = max(0, -floor(log10(step) + 1e-9))
        return f"{time:.{decimals}f} s"
    seconds = round(time)
    hours, minutes = divmod(seconds // 60, 60)
    if hours:
        return f"{hours}:{minutes:02}:{seconds % 60:02}"
    return f"{minutes}:{seconds % 60:02}"
