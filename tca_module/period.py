"""Computes when a periodic activity is due: at multiples of its period, without drift."""

import math

_EXACT = 1e-9  # seconds: the tolerance for rounding errors


class Period:
    """The times at which a periodic activity is due, in seconds. The caller passes the time.

    Attributes:
        seconds: the length of the period.
        due: when the present iteration is due.
        missed: the number of late iterations, which ended after the next one was due, and of
            skipped iterations.
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

        If the present one was late, that time has passed: the next one starts at once. Whole
        periods that have passed are skipped. A new length of the period, *seconds*, counts from the
        present iteration.
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
        """Change the length of the period, counted from the previous iteration.

        The present iteration moves only if it is not due yet, and never to a time in the past.
        """
        if self.due > now:
            self.due = max(now, self._previous_due + seconds)
            self._start, self._count = self.due, 0
            self.seconds = seconds
