"""A schedule without threads, in virtual time: for tests and for what-if questions."""

import contextlib
from collections.abc import Callable, Iterable, Iterator

from tca_behaviours.activities.processing.schedule import Processor, Schedule, StateActivity
from tca_behaviours.activities.processing.ticking import tick


def declared_cost(activity: StateActivity) -> float:
    """Return the declared execution time; 0 without a declaration."""
    return activity.estimate or 0.0


class VirtualBaton:
    """Runs a schedule as ``Baton`` does, in one thread and in virtual time.

    Args:
        cost: the virtual execution time of a tick in seconds. Default: the declared one.
    """

    def __init__(self, cost: Callable[[StateActivity], float] = declared_cost) -> None:
        self.schedule = Schedule()
        self.is_running = False
        self.lock = contextlib.nullcontext()
        self._cost = cost
        self._now = 0.0

    def clock(self) -> float:
        """Return the virtual time, in seconds."""
        return self._now

    @contextlib.contextmanager
    def changing(self) -> Iterator[Schedule]:
        """Start a ``with`` block that changes the schedule.

        Yields:
            The schedule.
        """
        try:
            yield self.schedule
        finally:
            self.schedule.update_order()

    def prepare(self, names: Iterable[str]) -> dict[str, Processor]:
        """Create the processors that do not exist yet.

        Args:
            names: the names of processors.

        Returns:
            The new processors, by name.
        """
        return {
            name: Processor(name, self._now)
            for name in names
            if self.schedule.processor(name) is None
        }

    def start(self) -> None:
        """Start; all activities are due."""
        self.is_running = True
        self.schedule.start(self._now)

    def stop(self) -> None:
        """Stop ticking."""
        self.is_running = False

    def run(self, seconds: float) -> None:
        """Let virtual time pass, and tick all activities that become due.

        Args:
            seconds: the virtual time that passes, in seconds.
        """
        end = self._now + seconds
        while self.is_running and (turn := self.schedule.next_turn(self._now)) and turn.at < end:
            self._now = max(self._now, turn.at)
            activity = self.schedule.begin(turn.processor, self._now)
            error = tick(activity.activity)
            self._now += self._cost(activity.activity)
            self.schedule.end(self._now, error)
        self._now = max(self._now, end)
