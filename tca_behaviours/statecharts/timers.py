"""The transitions that are made a time after their state was entered."""

from typing import Any, Generic

from tca_behaviours.statecharts.states import A, State


class Timers(Generic[A]):
    """The timed transitions of the active states, and when each is due."""

    def __init__(self) -> None:
        self._due: dict[A, float] = {}

    def enter(self, state: State[Any, A], now: float) -> None:
        """Start the timer of a state that is entered."""
        if (arrow := state.timed) is not None:
            assert arrow.after is not None
            self._due[arrow] = now + arrow.after

    def leave(self, state: State[Any, A]) -> None:
        """Stop the timer of a state that is left."""
        if state.timed is not None:
            self._due.pop(state.timed, None)

    @property
    def next(self) -> float | None:
        """When the next transition is due; None if no active state has one."""
        return min(self._due.values(), default=None)

    def due(self, now: float) -> A | None:
        """Return the transition that is due; None if there is none yet.

        The earliest comes first. Of several at one time, the one whose state was entered first.
        """
        arrow = min(self._due, key=self._due.__getitem__, default=None)
        return arrow if arrow is not None and self._due[arrow] <= now else None
