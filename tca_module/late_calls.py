"""Makes calls a little later, in one thread of the process.

Sends that wait for nothing share packets, and so do the replies of a turn. They leave with the next
call that sends or waits. If the program makes no such call in time, this thread sends them. It also
removes segments of large data that are free.
"""

import os
import threading
import time
from collections.abc import Callable

_RETRY_AFTER = 0.005  # seconds until a call that was not possible is made again
_IDLE_SECONDS = 1.0  # seconds without work after which the thread ends


class LateCalls:
    """The thread, and the calls that it makes."""

    def __init__(self) -> None:
        self._changed = threading.Condition(threading.Lock())
        self._due: dict[Callable[[], bool], float] = {}  #: call -> when to make it
        self._is_running = False

    def add(self, call: Callable[[], bool], seconds: float) -> None:
        """Make a call after some seconds, and again soon while it returns False."""
        with self._changed:
            due = time.monotonic() + seconds
            self._due[call] = min(due, self._due.get(call, due))
            if self._is_running:
                self._changed.notify()
            else:
                self._is_running = True
                threading.Thread(target=self._run, name="late calls", daemon=True).start()

    def _run(self) -> None:
        while ready := self._wait():
            for call in ready:
                if not call():
                    self.add(call, _RETRY_AFTER)

    def _wait(self) -> list[Callable[[], bool]]:
        """Wait until a call is due; return all that are. Returns [] if the thread must end."""
        with self._changed:
            while True:
                now, is_idle = time.monotonic(), not self._due
                ready = [call for call, due in self._due.items() if due <= now]
                for call in ready:
                    del self._due[call]
                if ready:
                    return ready
                seconds = min(self._due.values(), default=now + _IDLE_SECONDS) - now
                if not self._changed.wait(seconds) and is_idle and not self._due:
                    self._is_running = False
                    return []


_late_calls = LateCalls()


def late_calls() -> LateCalls:
    """Return the thread of this process."""
    return _late_calls


def _reset_after_fork() -> None:
    """Start afresh in a forked child, which has none of the threads."""
    global _late_calls  # noqa: PLW0603
    _late_calls = LateCalls()


os.register_at_fork(after_in_child=_reset_after_fork)
