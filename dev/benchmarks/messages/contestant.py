"""A contestant: one way to move messages or run tasks.

A contestant is the client, and starts all other processes.
"""

import os
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from dev.benchmarks.messages.processes import Children, resident_bytes

OPEN = 100
"""The number of exchanges that are open at a time, in the cases with many open ones."""
LISTENERS = 10
"""The receivers of a broadcast: ten connections of one process."""
ECHO, COUNT, MARK = b"e", b"c", b"m"
"""How bodies start: one to send back, one to count, and one that asks for the count."""
SOON = 20.0
"""The limit in seconds for a started program to answer."""
BLOCK = 5000
"""The limit for messages in one call: central queues 10,000."""


def body_of(size: int, kind: bytes = ECHO) -> bytes:
    """Return the body of a message."""
    return kind + bytes(size - len(kind))


class NotThere(Exception):
    """No answer yet."""


class Lost(Exception):
    """Some messages did not arrive."""


def check_arrived(sent: int, *arrived: int) -> None:
    """Raise Lost unless each receiver got all messages."""
    if any(number != sent for number in arrived):
        raise Lost(f"{sent} messages were sent, {', '.join(map(str, arrived))} arrived")


class Contestant(ABC):
    """A contestant, which is measured only in the cases whose methods it overrides.

    A method that raises NotImplementedError may say why.
    """

    broker = 0
    """The process of the broker; 0 without a broker."""
    receiver = 0
    """The process that receives single messages."""

    def __init__(self) -> None:
        self.children = Children()
        self._folder = TemporaryDirectory(prefix="tca-bench-")
        self.folder = Path(self._folder.name)

    @abstractmethod
    def start(self) -> None:
        """Start all processes and connect.

        The first message may still fail: see ``ready``.
        """

    def stop(self) -> None:
        """Stop everything that was started."""
        self.children.close()
        self._folder.cleanup()

    def ready(self) -> None:
        """Return when a message gets through."""
        until(lambda: self.round_trip(1, 100))

    def round_trip(self, number: int, size: int) -> list[float]:
        """Send messages with a body of *size*, each after the last reply; return the seconds of
        each.
        """
        raise NotImplementedError

    def pipelined(self, number: int, slots: int) -> None:
        """Send messages, ``OPEN`` at a time; *slots* handle them, if the contestant has slots."""
        raise NotImplementedError

    def oneway(self, number: int) -> None:
        """Send messages without replies; return when all have been handled."""
        raise NotImplementedError

    def many(self, number: int) -> tuple[float | str, ...]:
        """Send *number* messages as ``oneway`` does; return the memory of all ends, in MB.

        It is the broker's, its growth, the sender's and the receiver's.
        """
        ends = [self.broker, os.getpid(), self.receiver]
        self.oneway(1)
        before = resident_bytes(self.broker) if self.broker else 0
        for begun in range(0, number, BLOCK):
            self.oneway(min(BLOCK, number - begun))
        broker, sender, receiver = (resident_bytes(end) / 1e6 if end else 0.0 for end in ends)
        of_broker = (broker, broker - before / 1e6) if self.broker else ("no broker", "no broker")
        return *of_broker, sender, receiver

    def fanout(self, number: int) -> None:
        """Send *number* messages, each to all ``LISTENERS``."""
        raise NotImplementedError

    def commands(self, number: int) -> list[float]:
        """Run commands with a known end, one after the other; return the seconds of each."""
        raise NotImplementedError

    def commands_open(self, number: int) -> None:
        """Run commands as ``commands`` does, but ``OPEN`` at a time."""
        raise NotImplementedError

    def goals(self, number: int) -> list[float]:
        """Run goals with three parts, one after the other; return the seconds of each."""
        raise NotImplementedError

    def chain(self, number: int) -> None:
        """Run commands that are all sent first; each may start only when the one before is done."""
        raise NotImplementedError


def timed(number: int, act: Callable[[], object]) -> list[float]:
    """Return the seconds of each of *number* calls."""
    times = []
    for _ in range(number):
        begin = time.perf_counter()
        act()
        times.append(time.perf_counter() - begin)
    return times


def run_open(number: int, begin: Callable[[], Callable[[], object]], at_a_time: int = OPEN) -> None:
    """Start *number* exchanges, never more than *at_a_time*, and finish each."""
    pending: deque[Callable[[], object]] = deque()
    for _ in range(number):
        if len(pending) == at_a_time:
            pending.popleft()()
        pending.append(begin())
    for end in pending:
        end()


def shares(number: int) -> list[int]:
    """Return the number of exchanges for each of ``OPEN`` clients."""
    return [number // OPEN + (one < number % OPEN) for one in range(OPEN)]


def until(attempt: Callable[[], object], seconds: float = SOON) -> None:
    """Call *attempt* until it no longer raises NotThere."""
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
