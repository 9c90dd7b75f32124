"""The pace of simulated time, and the callback that may stop a move."""

import time
from collections.abc import Callable

OnTick = Callable[[], bool]
"""Called at each tick of a move. Returning False stops the move safely."""

LEAST_SLEEP = 0.005


class Pacer:
    """Slows simulated time down to *pace* times real time; 0 does not slow it."""

    def __init__(self, pace: float) -> None:
        self.pace = pace
        self._due = 0.0

    def restart(self) -> None:
        """Count from now on, so that idle time is not caught up."""
        self._due = time.monotonic()

    def wait(self, seconds: float) -> None:
        """Wait for the real time in which *seconds* of simulated time pass at this pace."""
        if self.pace <= 0:
            return
        self._due += seconds / self.pace
        ahead = self._due - time.monotonic()
        if ahead > LEAST_SLEEP:
            time.sleep(ahead)


class MoveWatch:
    """Follows one move and remembers whether it should stop."""

    def __init__(self, on_tick: OnTick | None = None) -> None:
        self._on_tick = on_tick
        self.stopped = False
        self.tilt = 0.0
        """The inclination (rad) of the body that stopped the move; 0 if none did."""

    def tick(self) -> None:
        """Call the callback, unless the move should already stop."""
        if self._on_tick is not None and not self.stopped:
            self.stopped = not self._on_tick()

    def stop_for_tilt(self, tilt: float) -> None:
        """Have the move stopped, because the body tilts too much. The first tilt is stored."""
        if not self.tilt:
            self.tilt, self.stopped = tilt, True
