"""How fast simulated time passes for the person who watches, and who is asked whether to go on."""

import time
from collections.abc import Callable

OnTick = Callable[[], bool]
"""Called at each tick of a move; answering False stops the move safely."""

LEAST_SLEEP = 0.005


class Pacer:
    """Holds simulated time back to *pace* times real time; 0 lets it run free."""

    def __init__(self, pace: float) -> None:
        self.pace = pace
        self._due = 0.0

    def restart(self) -> None:
        """Time in which the robot stood idle is not made up for."""
        self._due = time.monotonic()

    def passed(self, seconds: float) -> None:
        """Some simulated time has passed: wait until as much real time has."""
        if self.pace <= 0:
            return
        self._due += seconds / self.pace
        ahead = self._due - time.monotonic()
        if ahead > LEAST_SLEEP:
            time.sleep(ahead)


class MoveWatch:
    """Follows one move and remembers whether it was told to stop."""

    def __init__(self, on_tick: OnTick | None = None) -> None:
        self._on_tick = on_tick
        self.stopped = False
        self.tilt = 0.0
        """The inclination (rad) of the body for which the move was stopped, if it was."""

    def ticked(self) -> None:
        """Ask the listener; once it has said stop it is not asked again."""
        if self._on_tick is not None and not self.stopped:
            self.stopped = not self._on_tick()

    def tilted(self, tilt: float) -> None:
        """Stop: the body tilts too much."""
        if not self.tilt:
            self.tilt, self.stopped = tilt, True
