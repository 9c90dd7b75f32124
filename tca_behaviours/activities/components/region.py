"""A running region: one leaf state is active.

A tick makes at most one transition, so that the tick's execution time is bounded (decision 95).
Events wait in the region until a tick processes them.
"""

import time
from collections import deque
from collections.abc import Callable, Container, Sequence

import msgspec

from tca_behaviours.activities.components.states import RegionState, RegionTransition
from tca_behaviours.statecharts.soundness import check_arrows
from tca_behaviours.statecharts.states import UnsoundMachine, chart_of
from tca_behaviours.statecharts.timers import Timers
from tca_wire.charts import MachineChart


class RegionChange(msgspec.Struct, frozen=True):
    """A transition that was made."""

    component: str
    region: str
    source: str
    """The leaf that was left; "" at the start."""
    target: str
    """The leaf that was entered."""
    event: str
    """The event, or the time as in "after 5 s"; "" if the transition has none."""

    def __str__(self) -> str:
        by = f" ({self.event})" if self.event else ""
        return f"{self.component}.{self.region}: {self.source or 'start'} to {self.target}{by}"


class Region:
    """An orthogonal region of a component.

    A region runs its states without ``LibraryInterpreter``, which is slower. A test checks that
    both make the same transitions.
    """

    def __init__(self, component: str, name: str, period: float, estimate: float | None) -> None:
        self.root = RegionState(f"{component}.{name}" if component else name, None)
        self.active: tuple[RegionState, ...] = ()
        """The active states, innermost first."""
        self.component = component
        self.name = name
        self.period = period
        self.estimate = estimate
        self.state = self.root.state
        """Adds a state, as ``RegionState.state`` does."""
        self.states = self.root.by_name
        """All states of the region, by name."""
        self.events: deque[str] = deque()
        """The events that no tick has processed yet."""
        self.clock: Callable[[], float] = time.monotonic
        """The clock of timed transitions: that of the application."""
        self._timers = Timers[RegionTransition]()
        self._is_timed = False
        self._observers: list[Callable[[RegionChange], object]] = []

    @property
    def current(self) -> str:
        """The name of the active leaf state."""
        return self.active[0].label if self.active else ""

    @property
    def path(self) -> tuple[str, ...]:
        """The names of the active states, the outermost first."""
        return tuple(state.label for state in reversed(self.active))

    def is_in(self, name: str) -> bool:
        """Return whether a state is active.

        Args:
            name: the state's name.
        """
        return self.states[name].is_active

    def on_transition(self, function: Callable[[RegionChange], object]) -> None:
        """Call a function with each transition, in the tick that makes it.

        Args:
            function: a function that takes the RegionChange. It must be short.
        """
        self._observers.append(function)

    def check(self) -> None:
        """Raise UnsoundMachine if the region can't be run."""
        if not self.states:
            raise UnsoundMachine(f"region '{self.component}.{self.name}' has no state: add one")
        check_arrows(list(self.root.all())[1:])

    @property
    def chart(self) -> MachineChart:
        """The structure of the region as data."""
        return chart_of(self.name, list(self.root.all())[1:])

    # --- running ----------------------------------------------------------------------------------

    def reset(self) -> None:
        """Go to the first leaf, without calling entry functions."""
        self.events.clear()
        self._leave()
        self._timers = Timers()
        self._is_timed = any(state.timed is not None for state in self.states.values())
        self._go_to(self.root.leaf, "")
        self._start_timers(())

    def enter_first(self) -> None:
        """Call the entry functions of the active states, the outermost first."""
        for state in reversed(self.active):
            if state.entry is not None:
                state.entry()

    def tick(self) -> None:
        """Make the transition for the oldest event that has one.

        If no event has one, make the timed transition that is due, or else one without an event.
        """
        while self.events:
            if self.take(self.events.popleft()):
                return
        due = self._timers.due(self.clock()) if self._is_timed else None
        if due is not None:
            self._make(due)
        else:
            self.take("")

    def take(self, event: str) -> Sequence[RegionTransition]:
        """Process an event.

        Transitions of inner states come before those of outer states. Within a state, the
        transition that is written first comes first.

        Args:
            event: the name of the event; "" for a transition without one.

        Returns:
            The transition that was made, if any.
        """
        for state in self.active:
            for arrow in state.by_event.get(event, ()):
                if arrow.holds():
                    self._make(arrow)
                    return (arrow,)
        return ()

    def _make(self, arrow: RegionTransition) -> None:
        """Leave states up to the container around both ends, and enter states down to the target.

        The region stays consistent if a function raises. After an error of an exit function the
        region is in the old state, after an error of an entry function in the new one.
        """
        staying = arrow.shared_containers
        for state in self.active:
            if state not in staying and state.exit is not None:
                state.exit()
        if self._is_timed:
            for state in self.active:
                if state not in staying:
                    self._timers.leave(state)
        self._go_to(arrow.target.leaf, arrow.event if arrow.after is None else arrow.symbol)
        self._start_timers(staying)
        for state in reversed(self.active):
            if state not in staying and state.entry is not None:
                state.entry()

    def _go_to(self, leaf: RegionState, event: str) -> None:
        change = RegionChange(self.component, self.name, self.current, leaf.label, event)
        self._leave()
        self.active = leaf.path
        for state in self.active:
            state.is_active = True
        for function in self._observers:
            function(change)

    def _start_timers(self, staying: Container[RegionState]) -> None:
        if self._is_timed:
            for state in reversed(self.active):
                if state not in staying:
                    self._timers.enter(state, self.clock())

    def _leave(self) -> None:
        for state in self.active:
            state.is_active = False
        self.active = ()
