"""The robot as two threads share it: one moves it, the other scans between two control ticks of a
move.

The simulator is for one thread at a time. A scan that is wanted during a move is taken by the
moving thread at its next tick; otherwise by the thread that wants it.
"""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.planning.elevation import pack_scan
from robots.ambler_sim.planning.gait import with_foot
from robots.ambler_sim.vocabulary import NO_LEG, Scan, Stance

_LOOK_AGAIN = (
    0.02  # seconds after which a scan that no tick has taken looks whether the move has ended
)


class Machine:
    """A robot that may be scanned from while it moves."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._moving = threading.Lock()
        self._wanted: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._lifted = NO_LEG
        self._before = robot.stance()

    @contextmanager
    def moving(self, leg: int = NO_LEG) -> Iterator[None]:
        """The robot is this thread's for a move, of a leg or of the body; call ``tick`` between
        control ticks.
        """
        with self._moving:
            self._before, self._lifted = self.robot.stance(), leg
            try:
                yield
            finally:
                self._lifted = NO_LEG
                self.tick()

    def tick(self) -> None:
        """Take the scans that are wanted."""
        while not self._wanted.empty():
            self._wanted.get()()

    def scan(self) -> Scan:
        """One sweep of the range scanner, and the stance in which it was taken."""
        taken: queue.SimpleQueue[Scan] = queue.SimpleQueue()
        self._wanted.put(
            lambda: taken.put(pack_scan(self._stance_on_the_ground(), self.robot.scan()))
        )
        while taken.empty():
            if self._moving.acquire(timeout=_LOOK_AGAIN):
                try:
                    self.tick()
                finally:
                    self._moving.release()
        return taken.get()

    def _stance_on_the_ground(self) -> Stance:
        """The stance now, but a lifted foot is where it was lifted: maps take feet for points of
        the ground.
        """
        now = self.robot.stance()
        return now if self._lifted == NO_LEG else with_foot(now, self._before.feet[self._lifted])
