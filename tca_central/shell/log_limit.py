"""Keeps a client from flooding the log: limits repeated warnings, and the lines per second."""

import logging
import time
from collections.abc import Callable

PERIOD = 10.0  # seconds
_MOST_TOPICS = 100  # remembered at a time


class LogLimit:
    """Logs warnings, at most one per topic and period."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._warned_at: dict[str, float] = {}  #: by topic, oldest first: time of its last warning

    def warning(self, topic: str, text: str, *values: object) -> None:
        """Log a warning, unless its topic had one in this period or there are too many topics."""
        now = time.monotonic()
        while self._warned_at and now - next(iter(self._warned_at.values())) > PERIOD:
            del self._warned_at[next(iter(self._warned_at))]
        if topic not in self._warned_at and len(self._warned_at) < _MOST_TOPICS:
            self._warned_at[topic] = now
            self._log.warning(text, *values)


class LineLimit(logging.Filter):
    """Passes a limited number of lines per second, and all errors.

    The first line after a gap says how many were left out.
    """

    most = 200

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._second = 0
        self._count = 0  #: number of lines in that second
        self._left_out = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a line is logged."""
        if (second := int(self._clock())) != self._second:
            self._second, self._count = second, 0
        self._count += 1
        if self._count > self.most and record.levelno < logging.ERROR:
            self._left_out += 1
            return False
        if self._left_out:
            record.msg = (
                f"({self._left_out:,} lines left out: see the journal) {record.getMessage()}"
            )
            record.args, self._left_out = (), 0
        return True
