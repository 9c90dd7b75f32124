"""A region at work: one of its leaf states is active, and a tick of its machine makes one transition at most.

So the execution time of a tick is bounded. Events wait in the region until one leads somewhere.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from tca_behaviours.activities.components.states import HasStates, RegionState, RegionTransition, StateList


class RegionChange(NamedTuple):
    """A transition that was made."""

    component: str
    region: str
    source: str
    """The leaf that was left; empty at the start."""
    target: str
    """The leaf that was entered."""
    event: str
    """Empty: the transition has none."""

    def __str__(self) -> str:
        by = f" ({self.event})" if self.event else ""
        return f"{self.component}.{self.region}: {self.source or 'start'} to {self.target}{by}"


class Region(StateList, HasStates):
    """One of the orthogonal regions of a component."""

    def __init__(self, component: str, name: str, period: float, estimate: float | None) -> None:
        super().__init__(f"{component}.{name}")
        self.component = component
        self.name = name
        self.period = period
        self.estimate = estimate
        self.events: deque[str] = deque()
        """That have come, and that no tick has taken yet."""
        self._path: tuple[RegionState, ...] = ()
        self._told: list[Callable[[RegionChange], object]] = []

    def _new(self, name: str) -> RegionState:
        return self.new_state(name, None)

    @property
    def current(self) -> str:
        """The name of the active leaf state."""
        return self._path[0].name if self._path else ""

    @property
    def path(self) -> tuple[str, ...]:
        """The names of the active states, the outermost first."""
        return tuple(state.name for state in reversed(self._path))

    def is_in(self, name: str) -> bool:
        """Whether that state is active."""
        return self.states[name].is_active

    def on_transition(self, function: Callable[[RegionChange], object]) -> None:
        """Call a function with each transition, in the tick that makes it: it must be short."""
        self._told.append(function)

    # --- at work ----------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Go to the first state, without its entry function."""
        self.events.clear()
        self._leave()
        first = next(iter(self.states.values()))
        self._activate(first.entered_leaf(), "")

    def enter_first(self) -> None:
        """Call the entry functions of the states in which it begins."""
        for state in reversed(self._path):
            if state.entry is not None:
                state.entry()

    def tick(self) -> None:
        """Make the transition to which the oldest event leads; if none does, one without an event that may be made."""
        events = self.events
        while events:
            event = events.popleft()
            if transition := self._enabled(event):
                self._make(transition, event)
                return
        if transition := self._enabled(""):
            self._make(transition, "")

    def _enabled(self, event: str) -> RegionTransition | None:
        """The transition that an event leads to: of the innermost state first, then in the order written."""
        for state in self._path:
            for transition in state.transitions.get(event, ()):
                if transition.may_be_made():
                    return transition
        return None

    def _make(self, transition: RegionTransition, event: str) -> None:
        """Leave states up to the one around both ends, and enter those down to the target. The region is whole whatever
        an exit or entry function raises: still there, or there already.
        """
        for state in self._path:
            if state not in transition.around and state.exit is not None:
                state.exit()
        self._activate(transition.target.entered_leaf(), event)
        for state in reversed(self._path):
            if state not in transition.around and state.entry is not None:
                state.entry()

    def _activate(self, leaf: RegionState, event: str) -> None:
        source = self.current
        self._leave()
        self._path = tuple(leaf.around())
        for state in self._path:
            state.is_active = True
        change = RegionChange(self.component, self.name, source, leaf.name, event)
        for function in self._told:
            function(change)

    def _leave(self) -> None:
        for state in self._path:
            state.is_active = False
        self._path = ()
