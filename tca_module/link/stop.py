"""The signal to the threads of a module that the module must end."""

import threading
from collections.abc import Callable


class Stop(threading.Event):
    """The event that a module must end. Setting it also wakes threads with other waits."""

    def __init__(self) -> None:
        super().__init__()
        self._wakes: list[Callable[[], None]] = []
        self.crash = ""  #: the error that ended the program; "" if it ended regularly

    def on_set(self, wake: Callable[[], None]) -> None:
        """Call *wake* when the event is set. If it is set already, call *wake* at once."""
        self._wakes.append(wake)
        if self.is_set():
            wake()

    def set(self) -> None:
        """Make the module end."""
        super().set()
        for wake in list(self._wakes):
            wake()

    def set_from_signal(self) -> None:
        """Set the event from a signal handler, which must take no lock.

        No function of ``on_set`` is called. The thread that waits for this event wakes the others.
        """
        super().set()

    def clear(self) -> None:
        """Reset for the next run."""
        super().clear()
        self._wakes.clear()
