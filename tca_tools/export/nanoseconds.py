"""Times as whole nanoseconds, as Perfetto and MCAP want them: each entry's later than that of the
one before.
"""

from array import array
from bisect import bisect_left
from math import isfinite

from tca_tools.journal.whole_run import Run

_LATEST = 4e9
"""More than a century, in seconds: what is written later than that is no time."""


class Nanoseconds:
    """Turns the times of a past into nanoseconds since its epoch began.

    Entries of one and the same time, of which a coarse clock makes many, come one nanosecond after
    the other: so an effect is never as early as its cause.
    """

    def __init__(self, run: Run) -> None:
        self._times = run.times
        self._nanoseconds = array("q")
        last = -1
        for time in run.times:
            last = max(last + 1, _whole(time))
            self._nanoseconds.append(last)

    def __call__(self, time: float) -> int:
        """The nanosecond of an entry's time, or of any other."""
        place = bisect_left(self._times, time)
        if place < len(self._times) and self._times[place] == time:
            return self._nanoseconds[place]
        return _whole(time)


def since_1970(run: Run) -> int:
    """When the epoch began; 0 if that is not known."""
    return _whole(run.began or 0.0)


def _whole(time: float) -> int:
    return round(min(max(time, 0.0), _LATEST) * 1e9) if isfinite(time) else 0
