"""Measurements of running activities and processors. Pure: the caller passes the times."""

import math
from collections import deque

_WINDOW = 1.0  # seconds over which the load is measured
_MAX_PEAKS = 1000

Late = tuple[float, float]
"""When a tick ended late, and its response time."""


class TickTimes:
    """Times of ticks since the last change of the allocation."""

    def __init__(self) -> None:
        self.response = 0.0  #: the longest time from due to done
        # A tick stays here until another tick has the same response time or a longer one. For any
        # limit, the last tick above the limit is here.
        self._peaks: deque[Late] = deque(maxlen=_MAX_PEAKS)
        # From due to started.
        self._longest_delay, self._shortest_delay = -math.inf, math.inf

    @property
    def jitter(self) -> float:
        """How much the delays between due and started vary."""
        return max(0.0, self._longest_delay - self._shortest_delay)

    def add(self, due: float, began: float, ended: float) -> None:
        """Record a tick."""
        response = ended - due
        self.response = max(self.response, response)
        while self._peaks and self._peaks[-1][1] <= response:
            self._peaks.pop()
        self._peaks.append((ended, response))
        self._longest_delay = max(self._longest_delay, began - due)
        self._shortest_delay = min(self._shortest_delay, began - due)

    def last_above(self, limit: float) -> Late | None:
        """Return the last tick whose response time exceeds a limit, if any."""
        return next((one for one in reversed(self._peaks) if one[1] > limit), None)


class Execution:
    """Execution times of an activity's ticks. *estimate* is the declared longest time."""

    def __init__(self, estimate: float | None) -> None:
        self._estimate = math.inf if estimate is None else estimate
        self._longer = 0  # the number of ticks that took longer than declared
        self.ticks = 0
        self.errors = 0
        self.error = ""  #: the last error
        self.longest = 0.0  #: the longest execution time, in seconds
        self._total = 0.0

    @property
    def mean(self) -> float:
        """The mean execution time, in seconds."""
        return self._total / self.ticks if self.ticks else 0.0

    @property
    def is_refuted(self) -> bool:
        """Whether most ticks take longer than the declared time."""
        return 2 * self._longer > self.ticks

    def add(self, seconds: float, error: str) -> None:
        """Record a tick, and the error that it raised, if any."""
        self.ticks += 1
        self._total += seconds
        self.longest = max(self.longest, seconds)
        self._longer += seconds > self._estimate
        if error:
            self.errors += 1
            self.error = error


class Load:
    """The share of time that was used in the last second."""

    def __init__(self, now: float) -> None:
        self._since = now
        self._used = 0.0
        self._share: float | None = None

    def add(self, now: float, seconds: float) -> None:
        """Record that *seconds* were used until *now*."""
        self._used += seconds
        self._roll(now)

    def share(self, now: float) -> float:
        """Return the share, between 0 and 1."""
        self._roll(now)
        if self._share is None:
            return self._used / (now - self._since) if now > self._since else 0.0
        return self._share

    def _roll(self, now: float) -> None:
        if now - self._since >= _WINDOW:
            self._share = self._used / (now - self._since)
            self._since, self._used = now, 0.0
