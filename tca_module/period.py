"""Computes when a periodic activity is due: at multiples of its period, without drift."""

import math

_EXACT = 1e-9  # seconds: the tolerance for rounding errors


class Period:
    """The times at which a periodic activity is due, in seconds. The caller passes the time.

    Attributes:
        seconds: the length of the period.
        due: when the present iteration is due.
        missed: the number of late iterations, plus that of skipped iterations. An iteration is late
            if it ended after the next one was due.
        left_out: the number of skipped iterations.
    """

    def __init__(self, start: float, seconds: float) -> None:
        """Start with an iteration that is due at *start*."""
        self.seconds = seconds
        self.due = start
        self.missed = 0
        self.left_out = 0
        self._start = start
        self._count = 0
        self._previous_due = start - seconds  # when the previous iteration was due

    def next(self, now: float, seconds: float) -> float:
        """End the present iteration at *now*; return when the next one is due.

        If the present iteration was late, the returned time has passed, so that the next iteration
        starts at once. Whole periods that have passed are skipped. If *seconds* is a new length of
        the period, it counts from the due time of the present iteration.
        """
        if seconds != self.seconds:
            self._start, self._count, self.seconds = self.due, 0, seconds
        late = now - self._start - (self._count + 1) * seconds
        left_out = max(0, math.floor(late / seconds))
        self.missed += left_out + (late > _EXACT)
        self.left_out += left_out
        self._previous_due = self.due
        self._count += 1 + left_out
        self.due = self._start + self._count * seconds
        return self.due

    def change(self, now: float, seconds: float) -> None:
        """Change the length of the period, unless the present iteration is due already.

        The present iteration is then due *seconds* after the previous one, but not in the past. If
        the present iteration is due already, nothing changes: pass the new length to ``next``.
        """
        if self.due > now:
            self.due = max(now, self._previous_due + seconds)
            self._start, self._count = self.due, 0
            self.seconds = seconds
