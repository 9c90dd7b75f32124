"""A time axis: where times stand, sensible ticks, and their labels."""

from dataclasses import dataclass
from math import ceil, floor, log10

_MINUTES = (60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800, 43200, 86400)


@dataclass(frozen=True)
class Scale:
    """Where a time stands in the plot. *depths*: how many times wider it can be made."""

    width: float
    start: float
    end: float
    depths: tuple[int, ...] = (1,)

    @property
    def finest(self) -> float:
        """The finest detail, in pixels of the plot as it is at first."""
        return 1.0 / self.depths[-1]

    @property
    def pixel(self) -> float:
        """How many seconds the finest detail is."""
        return self.finest * (self.end - self.start) / self.width

    def x(self, time: float) -> float:
        """Where *time* is; at the edge, if it is beyond."""
        time, span = min(max(time, self.start), self.end), self.end - self.start
        return self.width * ((time - self.start) / span) if span > 0 else 0.0

    def depth_for(self, needed: float, width: float) -> int | None:
        """How many times wider the plot must be for what is *width* to be as wide as *needed*."""
        return next((depth for depth in self.depths if width * depth > needed), None)


def ticks(start: float, end: float, at_most: int) -> list[tuple[float, str]]:
    """Round times between *start* and *end*, no more than about *at_most*, with their labels."""
    step = _step((end - start) / max(at_most, 1))
    if step <= 0:
        return [(start, _label(start, 1.0))]
    first, last = ceil(start / step - 1e-9), floor(end / step + 1e-9)
    return [(number * step, _label(number * step, step)) for number in range(first, last + 1)]


def _step(shortest: float) -> float:
    """The shortest round step that is not shorter."""
    if shortest <= 0:
        return 0.0
    if shortest > 30:
        days = 86400 * ceil(shortest / 86400)
        return next((step for step in _MINUTES if step >= shortest), days)
    power = 10.0 ** floor(log10(shortest))
    nice = (factor * power for factor in (1, 2, 5, 10))
    step = next((step for step in nice if step >= shortest * (1 - 1e-9)), 10 * power)
    return 30.0 if step == 50 else step


def _label(time: float, step: float) -> str:
    """``0.25 s``, ``12 s``, ``3:30`` (minutes), ``1:05:00`` (hours)."""
    if step < 30:
        decimals = max(0, -floor(log10(step) + 1e-9))
        return f"{time:.{decimals}f} s"
    seconds = round(time)
    hours, minutes = divmod(seconds // 60, 60)
    if hours:
        return f"{hours}:{minutes:02}:{seconds % 60:02}"
    return f"{minutes}:{seconds % 60:02}"
