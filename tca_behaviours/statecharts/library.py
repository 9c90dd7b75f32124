"""Machines as statecharts of python-statemachine.

The library's rules (SCXML) decide which states are entered and left.
"""

from collections.abc import Iterator, Sequence
from typing import Any, Generic

from tca_behaviours.statecharts.states import A, S, State
from tca_wire.charts import StateKind
from tca_wire.text.missing import missing_package

try:
    from statemachine.io import create_machine_class_from_definition
except ImportError:
    raise ImportError(missing_package("a state machine", "python-statemachine", "charts")) from None


class LibraryChart(Generic[S]):
    """A statechart of the library, from the definition that a subclass passes to ``_compile``."""

    def __init__(self, states: Sequence[S]) -> None:
        """*states*: all states, in writing order."""
        self._names = {state: f"s{number}" for number, state in enumerate(states)}
        self._chart: Any = None

    def _compile(self, definition: dict[str, Any]) -> None:
        self._class: Any = create_machine_class_from_definition(
            "Machine",
            definition,
            catch_errors_as_events=False,  # errors stop the machine
            # soundness.py makes these checks instead, and its errors name the user's states
            validate_trap_states=False,
            validate_disconnected_states=False,
            validate_final_reachability=False,
        )
        for order, state in enumerate(_in_document_order(self._class.states), 1):
            state.document_order = order  # version 3.2 counts from 1 again in each container

    def begin(self) -> None:
        """Enter the first states.

        A chart that has ended is recreated. A chart that has not ended is reset, which is ten times
        as fast.
        """
        if self._chart is None or self._chart.is_terminated:
            self._chart = self._class()
        else:
            self._chart.current_state_value = None
            self._chart.activate_initial_state()

    def send(self, event: str) -> None:
        """Process an event, and all transitions that follow from it without another event."""
        self._chart.send(event)

    @property
    def active(self) -> list[S]:
        """The active states, in writing order."""
        names = self._active_names
        return [state for state, name in self._names.items() if name in names]

    @property
    def _active_names(self) -> Any:
        assert self._chart is not None, "call begin() first"
        return self._chart.configuration_values


def _in_document_order(states: Any) -> Iterator[Any]:
    for state in states:
        yield state
        yield from _in_document_order(state.states)


class LibraryInterpreter(LibraryChart[S], Generic[S, A]):
    """Runs a machine of events. A leaf becomes an atomic state of the library, a compound becomes a
    compound state.

    An event is processed to completion. For example, the event may end a compound, and so also the
    compound around it.
    """

    def __init__(self, states: Sequence[S]) -> None:
        super().__init__(states)
        events = dict.fromkeys(arrow.event for state in states for arrow in state.arrows)
        # The user may give events any names, but the library allows only some: number them.
        self._events = {event: f"e{number}" for number, event in enumerate(events)}
        self._situation: Any = None
        self._taken: list[A] = []
        top_states = [state for state in states if state.parent not in self._names]
        self._compile(
            {
                self._names[state]: self._definition_of(state, is_first=state is top_states[0])
                for state in top_states
            }
        )

    def take(self, event: str, situation: Any = None) -> Sequence[A]:
        """Process an event; guards read *situation*. Returns the arrows that were taken."""
        self._situation, self._taken = situation, []
        if event in self._events:
            self.send(self._events[event])
        return self._taken

    # --- the definition for the library -----------------------------------------------------------

    def _definition_of(self, state: State[S, A], *, is_first: bool) -> dict[str, Any]:
        is_end_of_compound = state.kind is StateKind.FINAL and state.parent in self._names
        defined: dict[str, Any] = {"initial": is_first, "final": is_end_of_compound}
        defined |= {"enter": state.entry, "exit": state.exit}
        if state.children:
            defined["states"] = {
                self._names[child]: self._definition_of(child, is_first=child is state.children[0])
                for child in state.children
            }
        on: dict[str, list[dict[str, Any]]] = {}
        for arrow in state.arrows:
            event = (
                self._events[arrow.event]
                if arrow.is_inherited
                else f"done.state.{self._names[arrow.source]}"
            )
            on.setdefault(event, []).append(self._transition(arrow))
        return defined | {"on": on}

    def _transition(self, arrow: A) -> dict[str, Any]:
        return {
            "target": self._names[arrow.target],
            "cond": lambda: arrow.holds(self._situation),
            "on": lambda: self._taken.append(arrow),
        }
