"""The clock of the core: the time of the newest event, and timers.

The clock is deterministic: timers due at the same time fire in the order in which they were set.
"""

import heapq
import math

from tca_central.errors import RequestError
from tca_central.model.stored import Stored
from tca_wire.vocabulary import LONGEST_TIME, Due, Refusal

VOID_TIMERS = 64
"""Cancelled timers that the queue may hold beyond half of its length."""


class Timer(Stored):
    """A time, the kind of event that is ``due`` then, and the object that the event concerns."""

    __slots__ = ("due", "is_cancelled", "subject", "time")

    def __init__(self, time: float, due: Due, subject: Stored | None) -> None:
        self.time, self.due, self.subject = time, due, subject
        self.is_cancelled = False


class Clock(Stored):
    """The current time and the timers, earliest first."""

    __slots__ = ("_cancelled", "_queue", "_set_count", "now")

    def __init__(self) -> None:
        self.now = 0.0  #: the time of the newest event, in seconds since the epoch began
        self._queue: list[tuple[float, int, Timer]] = []
        self._set_count = 0  #: number of timers ever set; orders timers of equal times
        self._cancelled = 0  #: number of cancelled timers in the queue

    def after(self, seconds: float, due: Due, subject: Stored | None) -> Timer:
        """Set a timer that is due in *seconds* seconds."""
        self._set_count += 1
        timer = Timer(self.now + seconds, due, subject)
        heapq.heappush(self._queue, (timer.time, self._set_count, timer))
        return timer

    def cancel(self, timer: Timer | None) -> None:
        """Cancel a timer.

        The timer stays in the queue until it reaches the front, or until more than half of the
        queue is cancelled.
        """
        if timer is None or timer.is_cancelled:
            return
        timer.is_cancelled, timer.subject = True, None
        self._cancelled += 1
        if self._cancelled > len(self._queue) // 2 + VOID_TIMERS:
            self._queue = [entry for entry in self._queue if not entry[2].is_cancelled]
            heapq.heapify(self._queue)
            self._cancelled = 0

    @property
    def timer_count(self) -> int:
        """The number of timers in the queue, including cancelled ones."""
        return len(self._queue)

    @property
    def next(self) -> float | None:
        """The time of the next timer; None if no timer is set."""
        while self._queue and self._queue[0][2].is_cancelled:
            heapq.heappop(self._queue)
            self._cancelled -= 1
        return self._queue[0][0] if self._queue else None

    def pop_due(self) -> Timer | None:
        """Remove and return the next timer that is due now; None if none is due."""
        while self._queue and self._queue[0][0] <= self.now:
            timer = heapq.heappop(self._queue)[2]
            if not timer.is_cancelled:
                timer.is_cancelled = True  # a later ``cancel`` must not count this timer
                return timer
            self._cancelled -= 1
        return None

    def pending(self) -> list[Timer]:
        """Return all timers that are set, in no particular order; for checks."""
        return [timer for _, _, timer in self._queue if not timer.is_cancelled]


def checked_seconds(seconds: float, what: str) -> float:
    """Return *seconds*. Raise RequestError if *seconds* is not from 0 to ``LONGEST_TIME``."""
    if not (math.isfinite(seconds) and 0 <= seconds <= LONGEST_TIME):
        raise RequestError(
            Refusal.PROTOCOL, f"{what} of {seconds:g} s: 0 to {LONGEST_TIME:g} s are possible"
        )
    return seconds
