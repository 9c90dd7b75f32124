"""A region at work: one of its leaf states is active, and a tick of its machine makes one
transition at most.

So the execution time of a tick is bounded (decision 95). Events wait in the region until one leads
somewhere.
"""

from collections import deque
from collections.abc import Callable, Sequence

import msgspec

from tca_behaviours.activities.components.states import RegionState, RegionTransition
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


class Region:
    """One of the orthogonal regions of a component. A test compares it with ``LibraryInterpreter``,
    its oracle.
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

    # --- at work ----------------------------------------------------------------------------------

    def reset(self) -> None:
        """Go to the first state, without its entry function."""
        self.events.clear()
        self._leave()
        self._go_to(self.root.leaf, "")

    def enter_first(self) -> None:
        """Call the entry functions of the states in which it begins."""
        for state in reversed(self.active):
            if state.entry is not None:
                state.entry()

    def tick(self) -> None:
        """Make the transition to which the oldest event leads; if none does, one without an event
        that may be made.
        """
        events = self.events
        while events:
            if self.take(events.popleft()):
                return
        self.take("")

    def take(self, event: str) -> Sequence[RegionTransition]:
        """Tell it of an event. The transition that was made, if any: of the innermost state first,
        then in the order written.
        """
        for state in self.active:
            for arrow in state.by_event.get(event, ()):
                if arrow.holds():
                    self._make(arrow)
                    return (arrow,)
        return ()

    def _make(self, arrow: RegionTransition) -> None:
        """Leave states up to the one around both ends, and enter those down to the target. The
        region is whole whatever an exit or entry function raises: still there, or there already.
        """
        staying = arrow.shared_containers
        for state in self.active:
            if state not in staying and state.exit is not None:
                state.exit()
        self._go_to(arrow.target.leaf, arrow.event)
        for state in reversed(self.active):
            if state not in staying and state.entry is not None:
                state.entry()

    def _go_to(self, leaf: RegionState, event: str) -> None:
        change = RegionChange(self.component, self.name, self.current, leaf.label, event)
        self._leave()
        self.active = leaf.path
        for state in self.active:
            state.is_active = True
        for function in self._told:
            function(change)

    def _leave(self) -> None:
        for state in self.active:
            state.is_active = False
        self.active = ()
