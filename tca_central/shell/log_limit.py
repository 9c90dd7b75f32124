"""Keeps a client from filling the log: a warning about one matter is said once in a while, and how often it came."""

import logging
import time
from collections.abc import Callable

PERIOD = 10.0  # seconds
_MATTERS = 100


class LogLimit:
    """Warnings, one a matter and period."""

    def __init__(self, log: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._clock = clock
        self._said: dict[str, float] = {}  #: when last, oldest first

    def warning(self, matter: str, text: str, *values: object) -> None:
        """Say it, unless that was said lately; where there are too many matters, too."""
        now = self._clock()
        while self._said and now - next(iter(self._said.values())) > PERIOD:
            del self._said[next(iter(self._said))]
        if matter not in self._said and len(self._said) < _MATTERS:
            self._said[matter] = now
            self._log.warning(text, *values)
