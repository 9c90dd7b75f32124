"""When something periodic is due: at multiples of its period, without drift."""

import math

_EXACT = 1e-9  # seconds: so much comes of rounding


class Period:
    """The times at which a task, or an activity, is due. Times, in seconds, are passed in."""

    def __init__(self, start: float, seconds: float) -> None:
        """The first iteration is at *start*."""
        self.seconds = seconds
        self.due = start  #: of the present iteration
        self.missed = (
            0  #: number of iterations that ended after the next was due, and of those left out
        )
        self.left_out = 0  #: of these, those left out
        self._start = start
        self._turn = 0
        self._before = start - seconds  # when the iteration before the present one was due

    def next(self, now: float, seconds: float) -> float:
        """The present iteration ends: when the next is due. One that is late begins at once; whole
        periods that have passed are left out. A new length of the period counts from the present
        iteration.
        """
        if seconds != self.seconds:
            self._start, self._turn, self.seconds = self.due, 0, seconds
        late = now - self._start - (self._turn + 1) * seconds
        left_out = max(0, math.floor(late / seconds))
        self.missed += left_out + (late > _EXACT)
        self.left_out += left_out
        self._before = self.due
        self._turn += 1 + left_out
        self.due = self._start + self._turn * seconds
        return self.due

    def change(self, now: float, seconds: float) -> None:
        """A new length of the period, from the iteration before the present one on. It moves the
        present one only if that is not due yet: then to no time that is past.
        """
        if self.due > now:
            self.due = max(now, self._before + seconds)
            self._start, self._turn = self.due, 0
            self.seconds = seconds
