"""A process of the simulation that runs real code with waits in it: a thread that runs only while
the clockwork waits for it. The code sleeps in simulated time, stands still, or is killed.
"""

import threading
from collections.abc import Callable

from simulation.clockwork import Clockwork


class Killed(BaseException):
    """The end of a fiber's process, in the midst of its code."""


class Fiber:
    """A thread that takes turns with the clockwork.

    Args:
        clockwork: Resumes the fiber.
        run: The code.
    """

    def __init__(self, clockwork: Clockwork, run: Callable[[], None]) -> None:
        self._clockwork, self._run = clockwork, run
        self.is_over = self._is_killed = False
        self.frozen_until = 0.0  #: the process stands still until then
        self._error: BaseException | None = None
        self._sleep = 0  #: number of the present sleep
        self._go, self._back = threading.Semaphore(0), threading.Semaphore(0)
        self._thread = threading.Thread(target=self._main, name="fiber", daemon=True)
        self._thread.start()
        self.nudge(0.0)

    # --- for the code -----------------------------------------------------------------------------

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self._sleep += 1
        self.nudge(seconds)
        self._back.release()
        self._go.acquire()
        if self._is_killed:
            raise Killed

    # --- for others -------------------------------------------------------------------------------

    def nudge(self, seconds: float) -> None:
        """End the present sleep after some seconds."""
        self._clockwork.after(seconds, self._resume, self._sleep)

    def kill(self) -> None:
        """End the process."""
        if not self.is_over:
            self._is_killed = True
            self._switch()

    # --- the turns --------------------------------------------------------------------------------

    def _resume(self, sleep: int) -> None:
        if sleep != self._sleep or self.is_over:
            return
        if self._clockwork.now < self.frozen_until:
            self._clockwork.after(self.frozen_until - self._clockwork.now, self._resume, sleep)
            return
        self._sleep += 1
        self._switch()

    def _switch(self) -> None:
        self._go.release()
        self._back.acquire()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _main(self) -> None:
        self._go.acquire()
        try:
            if not self._is_killed:
                self._run()
        except Killed:
            pass
        except BaseException as error:  # noqa: BLE001 - the clockwork's thread raises it
            self._error = error
        self.is_over = True
        self._back.release()
