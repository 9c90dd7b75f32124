"""One way to move messages or to run tasks. It is the client of what it measures, and starts all
others.
"""

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from dev.benchmarks.messages.processes import Children

OPEN = 100
"""Exchanges that are open at a time where there are many."""
LISTENERS = 10
"""They hear a broadcast: ten connections of one process."""
ECHO, COUNT, MARK = b"e", b"c", b"m"
"""How bodies begin: one to be sent back, to be counted, and one that asks for the number of
those.
"""
SOON = 20.0
"""Seconds until what was started answers."""


def body_of(size: int, kind: bytes = ECHO) -> bytes:
    """The body of a message."""
    return kind + bytes(size - len(kind))


class NotThere(Exception):
    """Nobody has answered yet."""


class Lost(Exception):
    """Not all messages have come."""


def check_arrived(sent: int, *arrived: int) -> None:
    """Raise Lost unless each has got all."""
    if any(number != sent for number in arrived):
        raise Lost(f"{sent} messages were sent, {', '.join(map(str, arrived))} came")


class Contestant(ABC):
    """What it can do is what it overrides; the others are left out of its rows."""

    def __init__(self) -> None:
        self.children = Children()
        self._folder = TemporaryDirectory(prefix="tca-bench-")
        self.folder = Path(self._folder.name)

    @abstractmethod
    def start(self) -> None:
        """Start all processes and connect. At its return the first message may still fail, see
        ``ready``.
        """

    def stop(self) -> None:
        """End all that was started."""
        self.children.stop()
        self._folder.cleanup()

    def ready(self) -> None:
        """Return when a message gets through."""
        until(lambda: self.round_trip(1, 100))

    def round_trip(self, number: int, size: int) -> list[float]:
        """Send a message with a body of *size* and get it back, one after the other: the seconds of
        each.
        """
        raise NotImplementedError

    def pipelined(self, number: int, slots: int) -> None:
        """The same, ``OPEN`` at a time; *slots* handle them, where the contestant has such."""
        raise NotImplementedError

    def oneway(self, number: int) -> None:
        """Send messages that are not answered; return when all have been handled."""
        raise NotImplementedError

    def fanout(self, number: int) -> None:
        """Send so many messages that each of ``LISTENERS`` gets them all."""
        raise NotImplementedError

    def commands(self, number: int) -> list[float]:
        """Have something done whose end is known, one after the other: the seconds of each."""
        raise NotImplementedError

    def commands_open(self, number: int) -> None:
        """The same, ``OPEN`` at a time."""
        raise NotImplementedError

    def goals(self, number: int) -> list[float]:
        """Have something done that has three parts, one after the other: the seconds of each."""
        raise NotImplementedError

    def chain(self, number: int) -> None:
        """So many commands, each of which may begin only when the one before it is done, all told
        of beforehand.
        """
        raise NotImplementedError


def timed(number: int, act: Callable[[], object]) -> list[float]:
    """The seconds of each of *number* calls."""
    taken = []
    for _ in range(number):
        begin = time.perf_counter()
        act()
        taken.append(time.perf_counter() - begin)
    return taken


def keep_open(number: int, begin: Callable[[], Callable[[], object]]) -> None:
    """Begin so many exchanges, never more than ``OPEN`` at a time, and end each."""
    pending: deque[Callable[[], object]] = deque()
    for _ in range(number):
        if len(pending) == OPEN:
            pending.popleft()()
        pending.append(begin())
    for end in pending:
        end()


def shares(number: int) -> list[int]:
    """How many of *number* exchanges each of ``OPEN`` makes, one after the other."""
    return [number // OPEN + (one < number % OPEN) for one in range(OPEN)]


def until(attempt: Callable[[], object], seconds: float = SOON) -> None:
    """Try until it does not raise NotThere any more."""
    end = time.monotonic() + seconds
    while True:
        try:
            attempt()
        except NotThere:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)
        else:
            return
