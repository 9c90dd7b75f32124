"""A component: its ports, the data that its activities share, and its regions."""

from collections.abc import Callable, Iterable
from functools import cached_property
from threading import Lock, get_ident
from typing import Any, Generic, TypeVar

from tca_behaviours.activities.components.ports import InputPort, OutputPort
from tca_behaviours.activities.components.region import Region
from tca_behaviours.activities.components.states import RegionState, RegionTransition
from tca_behaviours.statecharts.states import Step, UnsoundMachine
from tca_module import MisuseError
from tca_module.checks import check_known

D = TypeVar("D")
T = TypeVar("T")


class _Exclusion:
    """One thread at a time is inside a component. Processors take turns anyway, so that none ever
    waits here.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._thread = 0

    def __enter__(self) -> None:
        self._lock.acquire()
        self._thread = get_ident()

    def __exit__(self, *_: object) -> None:
        self._thread = 0
        self._lock.release()

    def is_mine(self) -> bool:
        return self._thread == get_ident()


class ComponentActivity:
    """An activity of a component. If *state* is given it does nothing while that is not active."""

    def __init__(
        self,
        component: "Component[Any]",
        name: str,
        step: Step,
        period: float,
        estimate: float | None,
        state: RegionState | None = None,
    ) -> None:
        self.name = f"{component.name}.{name}"
        self.component = component.name
        self.period = period
        self.estimate = estimate
        self._step = step
        self._state = state
        self._turn = component.turn

    def __repr__(self) -> str:
        return self.name

    def tick(self) -> None:
        """Do one step, alone in the component."""
        with self._turn:
            if self._state is None or self._state.is_active:
                self._step()


class Component(Generic[D]):
    """A component that others know by its ports only. Subclasses declare ports and regions in
    ``__init__``.

    *data* makes what its activities share. *period* and *estimate* are those of its port handler.
    """

    def __init__(
        self,
        name: str,
        data: Callable[[], D],
        *,
        period: float = 0.02,
        estimate: float | None = None,
    ) -> None:
        self.name = name
        self.inputs: dict[str, InputPort[Any]] = {}
        self.outputs: dict[str, OutputPort[Any]] = {}
        self.regions: dict[str, Region] = {}
        self.turn = _Exclusion()
        self.is_initialised = False
        self._new_data = data
        self._data: D | None = None
        self._period, self._estimate = period, estimate

    def __repr__(self) -> str:
        return f"{type(self).__name__} '{self.name}'"

    # --- how it is written ------------------------------------------------------------------------

    def input(
        self, name: str, type_: type[T], take: Callable[[T], object], *, keep: int = 1
    ) -> InputPort[T]:
        """An input port. The port handler calls *take* with each value that has arrived: with the
        newest one only, or with the *keep* newest ones, the oldest first.
        """
        self._check_new(name)
        port = self.inputs[name] = InputPort(self.name, name, type_, take, keep)
        return port

    def output(self, name: str, type_: type[T]) -> OutputPort[T]:
        """An output port."""
        self._check_new(name)
        port = self.outputs[name] = OutputPort(self.name, name, type_)
        return port

    def region(self, name: str, *, period: float, estimate: float | None = None) -> Region:
        """An orthogonal region. *period* and *estimate* are those of its state machine handler."""
        self._check_new(name)
        region = self.regions[name] = Region(self.name, name, period, estimate)
        return region

    def _check_new(self, name: str) -> None:
        if name in {**self.inputs, **self.outputs, **self.regions}:
            raise MisuseError(
                f"{self!r} has two ports or regions '{name}': give one of them another name"
            )

    # --- at work ----------------------------------------------------------------------------------

    @property
    def data(self) -> D:
        """What its activities share. Only they reach it, one at a time; others use the ports."""
        if not self.turn.is_mine():
            raise MisuseError(f"the data of {self!r} are for its own activities: use a port")
        assert self._data is not None, "initialise() comes first"
        return self._data

    def post(self, event: str) -> None:
        """Tell all regions of an event; from any thread. Raises MisuseError if none has a
        transition for it.
        """
        check_known(f"{self!r} has no event", event, sorted(self._takers))
        for region in self._takers[event]:
            region.events.append(event)

    def activities(self) -> list[ComponentActivity]:
        """All its activities, in the order in which data pass through them: the port handler, the
        state machine handlers of the regions, the activities of the states. Raises UnsoundMachine.
        """
        self._check()
        found: list[ComponentActivity] = []
        if self.inputs:
            found.append(
                ComponentActivity(
                    self, "port handler", self._take_arrived, self._period, self._estimate
                )
            )
        for region in self.regions.values():
            name = f"{region.name}.machine"
            found.append(ComponentActivity(self, name, region.tick, region.period, region.estimate))
        for region in self.regions.values():
            for state in region.states.values():
                if step := state.activity:
                    name = f"{region.name}.{state.label}"
                    found.append(
                        ComponentActivity(self, name, step, state.period, state.estimate, state)
                    )
        return found

    def initialise(self) -> None:
        """Begin anew: see ``initialise``."""
        initialise([self])

    def forget(self) -> None:
        """Make all as it was at first: data, ports, states."""
        self._check()
        with self.turn:
            for input_ in self.inputs.values():
                input_.clear()
            for output in self.outputs.values():
                output.clear()
            self._data = self._new_data()
            self.is_initialised = True
            for region in self.regions.values():
                region.reset()

    def begin(self) -> None:
        """Call the entry functions of the first states."""
        with self.turn:
            for region in self.regions.values():
                region.enter_first()

    def _take_arrived(self) -> None:
        for port in self.inputs.values():
            port.take_arrived()

    # --- what must be true of it ------------------------------------------------------------------

    @cached_property
    def _takers(self) -> dict[str, list[Region]]:
        """By the events: the regions that have transitions for them."""
        takers: dict[str, list[Region]] = {}
        for region in self.regions.values():
            for event in {
                event: None for state in region.states.values() for event in state.by_event if event
            }:
                takers.setdefault(event, []).append(region)
        return takers

    def _check(self) -> None:
        for region in self.regions.values():
            for state in region.states.values():
                for transition in state.arrows:
                    transition.needed = [self._named(need, transition) for need in transition.needs]
            region.check()

    def _named(self, need: str, transition: RegionTransition) -> RegionState:
        region, _, state = need.partition(".")
        if region not in self.regions or state not in self.regions[region].states:
            raise UnsoundMachine(
                f"{transition!r} needs '{need}', which is no state: write \"region.state\""
            )
        return self.regions[region].states[state]


def initialise(components: Iterable[Component[Any]]) -> None:
    """Begin anew: data, ports and regions are as at first, then entry functions are called.
    Connected components are initialised together, so that what one sets at its beginning arrives at
    the other.
    """
    components = list(components)
    for component in components:
        if component.turn.is_mine():
            raise MisuseError(
                f"{component!r} can't be initialised from a tick of its own: use another thread"
            )
    for component in components:
        component.forget()
    for component in components:
        component.begin()
