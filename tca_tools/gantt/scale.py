"""Where times stand in a chart."""

from dataclasses import dataclass


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
