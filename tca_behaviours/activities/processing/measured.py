"""What is measured of activities and processors while they run. Pure: times are passed in."""

import math
from collections import deque

_WINDOW = 1.0  # seconds over which the load is taken
_MOST_PEAKS = 1000

Late = tuple[float, float]
"""When a tick ended late, and its response time."""


class TickTimes:
    """Times of ticks since the last change of the allocation."""

    def __init__(self) -> None:
        self.response = 0.0  #: the longest from being due to the end
        # Those after which none was as long: the last one above any limit is among them.
        self._peaks: deque[Late] = deque(maxlen=_MOST_PEAKS)
        self._longest_delay, self._shortest_delay = (
            -math.inf,
            math.inf,
        )  # from being due to the beginning

    @property
    def jitter(self) -> float:
        """By how much the beginnings of ticks vary against the times at which they are due."""
        return max(0.0, self._longest_delay - self._shortest_delay)

    def add(self, due: float, began: float, ended: float) -> None:
        """Take in a tick."""
        response = ended - due
        self.response = max(self.response, response)
        while self._peaks and self._peaks[-1][1] <= response:
            self._peaks.pop()
        self._peaks.append((ended, response))
        self._longest_delay = max(self._longest_delay, began - due)
        self._shortest_delay = min(self._shortest_delay, began - due)

    def last_above(self, limit: float) -> Late | None:
        """The last tick with a longer response time, if any."""
        return next((one for one in reversed(self._peaks) if one[1] > limit), None)


class Execution:
    """How long the ticks of an activity take. *estimate* was declared as the longest time."""

    def __init__(self, estimate: float | None) -> None:
        self._estimate = math.inf if estimate is None else estimate
        self._longer = 0  # ticks that took longer than declared
        self.ticks = 0
        self.errors = 0
        self.error = ""
        self.longest = 0.0
        self._total = 0.0

    @property
    def mean(self) -> float:
        """Seconds a tick."""
        return self._total / self.ticks if self.ticks else 0.0

    @property
    def is_refuted(self) -> bool:
        """Whether most ticks take longer than was declared."""
        return 2 * self._longer > self.ticks

    def add(self, seconds: float, error: str) -> None:
        """Take in a tick, and the error that it raised, if any."""
        self.ticks += 1
        self._total += seconds
        self.longest = max(self.longest, seconds)
        self._longer += seconds > self._estimate
        if error:
            self.errors += 1
            self.error = error


class Load:
    """The share of time that is used, in the last second."""

    def __init__(self, now: float) -> None:
        self._since = now
        self._used = 0.0
        self._share: float | None = None

    def add(self, now: float, seconds: float) -> None:
        """So much was used, until now."""
        self._used += seconds
        self._roll(now)

    def share(self, now: float) -> float:
        """Between 0 and 1."""
        self._roll(now)
        if self._share is None:
            return self._used / (now - self._since) if now > self._since else 0.0
        return self._share

    def _roll(self, now: float) -> None:
        if now - self._since >= _WINDOW:
            self._share = self._used / (now - self._since)
            self._since, self._used = now, 0.0
