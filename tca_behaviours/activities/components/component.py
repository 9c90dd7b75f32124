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
    """A lock that admits one thread at a time to a component.

    Processors take turns, so a tick waits here only for calls of other threads.
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
    """An activity of a component. If the activity belongs to a *state*, its ticks do nothing while
    that state is not active.
    """

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
        self._exclusion = component.exclusion

    def __repr__(self) -> str:
        return self.name

    def tick(self) -> None:
        """Do one step, with exclusive access to the component."""
        with self._exclusion:
            if self._state is None or self._state.is_active:
                self._step()


class Component(Generic[D]):
    """A part of an application. Other parts reach it only through its ports.

    A subclass declares its ports and regions in ``__init__``.

    Args:
        name: the component's name, unique in its application.
        data: a class or function that makes the shared data of the component's activities.
        period: seconds between two ticks of its port handler. Default: 0.02.
        estimate: the longest execution time of the port handler in seconds; None: measure it.

    Example::

        class Lamp(Component[LampData]):
            def __init__(self, name: str) -> None:
                super().__init__(name, LampData)
                self.switch = self.input("switch", bool, self.take_switch)
                power = self.region("power", period=0.1)
                off, on = power.state("off"), power.state("on", entry=self.turn_on)
                off.to(on, on="switched on")
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
        self.exclusion = _Exclusion()
        self.is_initialised = False
        self._new_data = data
        self._data: D | None = None
        self._period, self._estimate = period, estimate

    def __repr__(self) -> str:
        return f"{type(self).__name__} '{self.name}'"

    # --- declarations -----------------------------------------------------------------------------

    def input(
        self, name: str, type_: type[T], take: Callable[[T], object], *, keep: int = 1
    ) -> InputPort[T]:
        """Declare an input port.

        Args:
            name: the port's name.
            type_: the class of its values.
            take: a function that the port handler calls with each value that has arrived, the
                oldest first.
            keep: how many of the newest values the port holds between two calls of the port
                handler. Default: 1.

        Returns:
            The port.
        """
        self._check_new(name)
        port = self.inputs[name] = InputPort(self.name, name, type_, take, keep)
        return port

    def output(self, name: str, type_: type[T]) -> OutputPort[T]:
        """Declare an output port.

        Args:
            name: the port's name.
            type_: the class of its values.

        Returns:
            The port.

        Raises:
            MisuseError: the name is in use, or *type_* is no class.
        """
        self._check_new(name)
        port = self.outputs[name] = OutputPort(self.name, name, type_)
        return port

    def region(self, name: str, *, period: float, estimate: float | None = None) -> Region:
        """Declare an orthogonal region.

        Args:
            name: the region's name.
            period: seconds between two ticks of its state machine.
            estimate: the longest execution time of such a tick in seconds; None: it is measured.

        Returns:
            The region; its ``state`` adds states.
        """
        self._check_new(name)
        region = self.regions[name] = Region(self.name, name, period, estimate)
        return region

    def _check_new(self, name: str) -> None:
        if name in {**self.inputs, **self.outputs, **self.regions}:
            raise MisuseError(
                f"{self!r} has two ports or regions '{name}': give one of them another name"
            )

    # --- running ----------------------------------------------------------------------------------

    @property
    def data(self) -> D:
        """The data that the component's activities share. All other code uses the ports.

        Raises:
            MisuseError: the caller is none of the component's activities.
        """
        if not self.exclusion.is_mine():
            raise MisuseError(f"the data of {self!r} are for its own activities: use a port")
        assert self._data is not None, "call initialise() first"
        return self._data

    def post(self, event: str) -> None:
        """Send an event to all regions that have a transition for it. Thread-safe.

        Args:
            event: the name of the event.

        Raises:
            MisuseError: no region has such a transition.
        """
        check_known(f"{self!r} has no event", event, sorted(self._regions_by_event))
        for region in self._regions_by_event[event]:
            region.events.append(event)

    def activities(self) -> list[ComponentActivity]:
        """Return all activities of the component: the port handler, the state machines of the
        regions, and the activities of the states.

        Data pass through the activities in this order.

        Raises:
            UnsoundMachine: the component can't be run.
        """
        self._check()
        found: list[ComponentActivity] = []
        if self.inputs:
            found.append(
                ComponentActivity(
                    self, "port handler", self._deliver_arrived, self._period, self._estimate
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
        """Reset data, ports and regions, and call the entry functions of the first states."""
        initialise([self])

    def reset(self) -> None:
        """Reset data, ports and states, without calling entry functions."""
        self._check()
        with self.exclusion:
            for input_ in self.inputs.values():
                input_.clear()
            for output in self.outputs.values():
                output.clear()
            self._data = self._new_data()
            self.is_initialised = True
            for region in self.regions.values():
                region.reset()

    def enter_first(self) -> None:
        """Call the entry functions of the first states."""
        with self.exclusion:
            for region in self.regions.values():
                region.enter_first()

    def _deliver_arrived(self) -> None:
        for port in self.inputs.values():
            port.deliver_arrived()

    # --- checks -----------------------------------------------------------------------------------

    @cached_property
    def _regions_by_event(self) -> dict[str, list[Region]]:
        """The regions that have a transition for an event, by event."""
        regions: dict[str, list[Region]] = {}
        for region in self.regions.values():
            arrows = [arrow for state in region.states.values() for arrow in state.arrows]
            events = dict.fromkeys(arrow.event for arrow in arrows if arrow.after is None)
            for event in filter(None, events):
                regions.setdefault(event, []).append(region)
        return regions

    def _check(self) -> None:
        for region in self.regions.values():
            for state in region.states.values():
                for transition in state.arrows:
                    transition.needed = [
                        self._needed_state(need, transition) for need in transition.needs
                    ]
            region.check()

    def _needed_state(self, need: str, transition: RegionTransition) -> RegionState:
        region, _, state = need.partition(".")
        if region not in self.regions or state not in self.regions[region].states:
            raise UnsoundMachine(
                f"{transition!r} needs '{need}', which is not a state: write \"region.state\""
            )
        return self.regions[region].states[state]


def initialise(components: Iterable[Component[Any]]) -> None:
    """Reset the data, ports and regions of all components. Then call the entry functions.

    Initialise connected components together. Otherwise a value that one component's entry function
    sets would be lost when the other component is reset.

    Args:
        components: the components.

    Raises:
        MisuseError: the call comes from a tick of one of the components.
    """
    components = list(components)
    for component in components:
        if component.exclusion.is_mine():
            raise MisuseError(
                f"{component!r} can't be initialised from one of its own ticks: use another thread"
            )
    for component in components:
        component.reset()
    for component in components:
        component.enter_first()
