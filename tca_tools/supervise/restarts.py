"""When a program that has ended starts again. Pure: the caller passes the times."""

import signal

from tca_tools.supervise.robot_file import Limits

_LONGEST_DOUBLING = 30


class Restarts:
    """The recent ends of one program."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._ends: list[float] = []

    @property
    def count(self) -> int:
        """The number of ends that count now."""
        return len(self._ends)

    def delay(self, now: float) -> float | None:
        """Record an end at *now*. Return the seconds to wait; None if it has ended too often."""
        limits = self._limits
        self._ends = [*(end for end in self._ends if end > now - limits.within), now]
        if self.count > limits.restarts:
            return None
        return min(
            limits.longest_delay, limits.delay * 2.0 ** min(self.count - 1, _LONGEST_DOUBLING)
        )


def how_it_ended(code: int) -> str:
    """Return the end of a process in words, from its return code."""
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:  # a real-time signal
        return f"was ended by signal {-code}"
