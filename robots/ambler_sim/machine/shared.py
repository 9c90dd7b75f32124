"""A robot shared by two threads: one moves it, the other scans between two control ticks of a move.

The simulator may be used by one thread at a time. During a move the moving thread takes each
requested scan at its next tick. Otherwise the requesting thread takes it.
"""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.planning.elevation import pack_scan
from robots.ambler_sim.planning.gait import with_foot
from robots.ambler_sim.vocabulary import NO_LEG, Scan, Stance

# Seconds after which a waiting scan checks whether the move has ended.
_POLL_PERIOD = 0.02


class Machine:
    """A robot whose scanner can be used while it moves."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._moving = threading.Lock()
        self._requests: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._lifted = NO_LEG
        self._before = robot.stance()

    @contextmanager
    def exclusive(self, leg: int = NO_LEG) -> Iterator[None]:
        """Reserve the robot for this thread. During a move call ``tick`` between control ticks."""
        with self._moving:
            self._before, self._lifted = self.robot.stance(), leg
            try:
                yield
            finally:
                self._lifted = NO_LEG
                self.tick()

    def tick(self) -> None:
        """Take the requested scans."""
        while not self._requests.empty():
            self._requests.get()()

    def scan(self) -> Scan:
        """Take one sweep of the range scanner. Returns the points with the stance of the robot."""
        taken: queue.SimpleQueue[Scan] = queue.SimpleQueue()
        self._requests.put(
            lambda: taken.put(pack_scan(self._stance_on_the_ground(), self.robot.scan()))
        )
        while taken.empty():
            if self._moving.acquire(timeout=_POLL_PERIOD):
                try:
                    self.tick()
                finally:
                    self._moving.release()
        return taken.get()

    def _stance_on_the_ground(self) -> Stance:
        """Return the present stance, but with a lifted foot where it was lifted. Maps use the feet
        as points of the ground.
        """
        now = self.robot.stance()
        return now if self._lifted == NO_LEG else with_foot(now, self._before.feet[self._lifted])
