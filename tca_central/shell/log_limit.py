"""Keeps a client from filling the log: a warning of one matter is said once in a while, and so many
lines a second.
"""

import logging
import time
from collections.abc import Callable

PERIOD = 10.0  # seconds
_MATTERS = 100


class LogLimit:
    """Warnings, one a matter and period."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._said: dict[str, float] = {}  #: when last, oldest first

    def warning(self, matter: str, text: str, *values: object) -> None:
        """Say it, unless that was said lately; where there are too many matters, too."""
        now = time.monotonic()
        while self._said and now - next(iter(self._said.values())) > PERIOD:
            del self._said[next(iter(self._said))]
        if matter not in self._said and len(self._said) < _MATTERS:
            self._said[matter] = now
            self._log.warning(text, *values)


class LineLimit(logging.Filter):
    """Lets so many lines a second pass, and all errors; the next line says how many were left
    out.
    """

    most = 200

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._second = 0
        self._count = 0  #: lines in that second
        self._left_out = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a line is to be written."""
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
