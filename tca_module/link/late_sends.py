"""Sends what a connection holds back, if its own thread does not send it in time.

Sends that wait for nothing share packets, and so do the replies of a turn. They leave with the next
call that sends or waits. If the program makes no such call, one thread of the process sends them.
"""

import os
import threading
import time
from typing import Protocol

_RETRY_AFTER = 0.005  # seconds until a send that was not possible is tried again
_IDLE_SECONDS = 1.0  # seconds without work after which the thread ends


class HoldingLine(Protocol):
    """A line that holds packets back."""

    def send_held(self) -> bool:
        """Send them, from another thread; return False if that is not possible now."""


class LateSends:
    """The thread that sends, and the lines for which it does."""

    def __init__(self) -> None:
        self._changed = threading.Condition(threading.Lock())
        self._due: dict[HoldingLine, float] = {}  #: line -> when the thread sends for it
        self._is_running = False

    def add(self, line: HoldingLine, seconds: float) -> None:
        """Send what a line holds back after some seconds, once."""
        with self._changed:
            due = time.monotonic() + seconds
            self._due[line] = min(due, self._due.get(line, due))
            if self._is_running:
                self._changed.notify()
            else:
                self._is_running = True
                threading.Thread(target=self._run, name="late sends", daemon=True).start()

    def _run(self) -> None:
        while ready := self._wait():
            for line in ready:
                if not line.send_held():
                    self.add(line, _RETRY_AFTER)

    def _wait(self) -> list[HoldingLine]:
        """Wait until a send is due; return the lines. Returns [] if the thread must end."""
        with self._changed:
            while True:
                now, is_idle = time.monotonic(), not self._due
                ready = [line for line, due in self._due.items() if due <= now]
                for line in ready:
                    del self._due[line]
                if ready:
                    return ready
                seconds = min(self._due.values(), default=now + _IDLE_SECONDS) - now
                if not self._changed.wait(seconds) and is_idle and not self._due:
                    self._is_running = False
                    return []


_late_sends = LateSends()


def late_sends() -> LateSends:
    """Return the thread of this process."""
    return _late_sends


def _reset_after_fork() -> None:
    """Start afresh in a forked child, which has none of the threads."""
    global _late_sends  # noqa: PLW0603
    _late_sends = LateSends()


os.register_at_fork(after_in_child=_reset_after_fork)
