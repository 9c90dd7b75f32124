"""Times as whole nanoseconds for Perfetto and MCAP; each entry is later than the one before."""

from array import array
from bisect import bisect_left
from math import isfinite

from tca_tools.journal.whole_run import Run

_LATEST = 4e9
"""More than a century, in seconds: a later time in a journal is an error."""


class Nanoseconds:
    """Converts the times of a run into nanoseconds since the start of its epoch.

    Entries of equal time, which a coarse clock causes, follow each other by one nanosecond. An
    effect is therefore always later than its cause.
    """

    def __init__(self, run: Run) -> None:
        self._times = run.times
        self._nanoseconds = array("q")
        last = -1
        for time in run.times:
            last = max(last + 1, _whole(time))
            self._nanoseconds.append(last)

    def __call__(self, time: float) -> int:
        """Return the nanosecond of an entry's time, or of any other time."""
        place = bisect_left(self._times, time)
        if place < len(self._times) and self._times[place] == time:
            return self._nanoseconds[place]
        return _whole(time)


def since_1970(run: Run) -> int:
    """Return the start of the epoch in nanoseconds since 1970; 0 if it is unknown."""
    return _whole(run.began or 0.0)


def _whole(time: float) -> int:
    return round(min(max(time, 0.0), _LATEST) * 1e9) if isfinite(time) else 0
