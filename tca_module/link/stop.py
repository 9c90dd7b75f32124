"""Tells the threads of a module that it is to end."""

import threading
from collections.abc import Callable


class Stop(threading.Event):
    """Set when a module is to end; whoever waits for something else meanwhile is woken."""

    def __init__(self) -> None:
        super().__init__()
        self._wakes: list[Callable[[], None]] = []

    def wakes(self, wake: Callable[[], None]) -> None:
        """From now on call this, too, when it is set."""
        self._wakes.append(wake)
        if self.is_set():
            wake()

    def set(self) -> None:
        """Have the module end."""
        super().set()
        for wake in list(self._wakes):
            wake()

    def note(self) -> None:
        """Have it end, from a signal's handler, which must take no lock: who waits for this wakes
        the others.
        """
        super().set()

    def clear(self) -> None:
        """Begin anew."""
        super().clear()
        self._wakes.clear()
