"""When a program that has ended starts again. Without clocks: times come from outside."""

import signal

from tca_tools.supervise.robot_file import Limits

_LONGEST_DOUBLING = 30


class Restarts:
    """The late ends of one program, as far as they count."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._ends: list[float] = []

    @property
    def count(self) -> int:
        """The ends that count now."""
        return len(self._ends)

    def delay(self, now: float) -> float | None:
        """Seconds to wait after an end at *now*; None: it has ended too often."""
        limits = self._limits
        self._ends = [*(end for end in self._ends if end > now - limits.within), now]
        if self.count > limits.restarts:
            return None
        return min(
            limits.longest_delay, limits.delay * 2.0 ** min(self.count - 1, _LONGEST_DOUBLING)
        )


def how_it_ended(code: int) -> str:
    """The end of a process in words, from its return code."""
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:  # a real-time signal
        return f"was ended by signal {-code}"
