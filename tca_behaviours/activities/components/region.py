"""A region at work: one of its leaf states is active, and a tick of its machine makes one transition at most.

So the execution time of a tick is bounded. Events wait in the region until one leads somewhere.
"""

from collections import deque
from collections.abc import Callable

import msgspec

from tca_behaviours.activities.components.states import RegionState, RegionTransition
from tca_behaviours.statecharts.fast import FastInterpreter
from tca_behaviours.statecharts.soundness import check_arrows
from tca_behaviours.statecharts.states import UnsoundMachine, chart_of
from tca_wire.charts import MachineChart


class RegionChange(msgspec.Struct, frozen=True):
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


class Region(FastInterpreter[RegionState, RegionTransition]):
    """One of the orthogonal regions of a component."""

    def __init__(self, component: str, name: str, period: float, estimate: float | None) -> None:
        super().__init__(RegionState(f"{component}.{name}" if component else name, None))
        self.component = component
        self.name = name
        self.period = period
        self.estimate = estimate
        self.state = self.root.state
        self.states = self.root.beside
        """All its states, by their names."""
        self.events: deque[str] = deque()
        """That have come, and that no tick has taken yet."""
        self._told: list[Callable[[RegionChange], object]] = []

    @property
    def current(self) -> str:
        """The name of the active leaf state."""
        return self.active[0].label if self.active else ""

    @property
    def path(self) -> tuple[str, ...]:
        """The names of the active states, the outermost first."""
        return tuple(state.label for state in reversed(self.active))

    def is_in(self, name: str) -> bool:
        """Whether that state is active."""
        return self.states[name].is_active

    def on_transition(self, function: Callable[[RegionChange], object]) -> None:
        """Call a function with each transition, in the tick that makes it: it must be short."""
        self._told.append(function)

    def check(self) -> None:
        """Raises UnsoundMachine if it can't be run."""
        if not self.states:
            raise UnsoundMachine(f"region '{self.component}.{self.name}' has no state: add one")
        check_arrows(list(self.root.all())[1:])

    @property
    def chart(self) -> MachineChart:
        """Its structure as data."""
        return chart_of(self.name, list(self.root.all())[1:])

    # --- at work ----------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Go to the first state, without its entry function."""
        self.events.clear()
        super().reset()

    def tick(self) -> None:
        """Make the transition to which the oldest event leads; if none does, one without an event that may be made."""
        events = self.events
        while events:
            if self.take(events.popleft()):
                return
        self.take("")

    def _note(self, source: RegionState, leaf: RegionState, event: str) -> None:
        before = source.label if source is not self.root else ""
        change = RegionChange(self.component, self.name, before, leaf.label, event)
        for function in self._told:
            function(change)
