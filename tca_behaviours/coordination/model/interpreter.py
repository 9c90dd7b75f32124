"""A running machine: the transitions that events cause, from leaf to leaf."""

from typing import NamedTuple

from tca_behaviours.coordination.model.situation import Situation
from tca_behaviours.coordination.model.states import AuthoredArrow, AuthoredState
from tca_behaviours.statecharts.library import LibraryInterpreter
from tca_behaviours.statecharts.timers import Timers
from tca_wire.charts import StateKind


class TakenArrow(NamedTuple):
    """A transition from one leaf to another."""

    before: int
    symbol: str
    after: int


class Interpreter:
    """A running machine. It starts in the leaf that is entered first."""

    def __init__(self, states: list[AuthoredState]) -> None:
        self._states = states
        self._chart = LibraryInterpreter[AuthoredState, AuthoredArrow](states)
        self.restart()

    def restart(self, now: float = 0.0) -> None:
        """Return to the first leaf.

        Args:
            now: the time, in seconds, from which the delays of the leaf count. Default: 0.
        """
        self._chart.begin()
        self.current = self._states[0].leaf.number
        """The current leaf."""
        self.timers = Timers[AuthoredArrow]()
        for state in reversed(self.state.path):
            self.timers.enter(state, now)

    @property
    def state(self) -> AuthoredState:
        """The current leaf, as it is written."""
        return self._states[self.current]

    @property
    def is_ended(self) -> bool:
        """Whether the machine has reached its final state."""
        return self.state.kind is StateKind.FINAL

    def take(self, event: str, situation: Situation, now: float = 0.0) -> list[TakenArrow]:
        """Process an event; "done" and "failed" are those of the current activity.

        Args:
            event: the name of the event.
            situation: what guards read.
            now: the time, for the timers of the states that are entered.

        Returns:
            The transitions that were taken: none if no guard allows one, several if the event has
            ended a compound.
        """
        taken = []
        for arrow in self._chart.take(event, situation):
            for state in self.state.path:
                if state not in arrow.shared_containers:
                    self.timers.leave(state)
            taken.append(TakenArrow(self.current, arrow.symbol, arrow.target.leaf.number))
            self.current = taken[-1].after
            for state in reversed(self.state.path):
                if state not in arrow.shared_containers:
                    self.timers.enter(state, now)
        return taken
