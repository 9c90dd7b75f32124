"""Machines as statecharts of python-statemachine, whose rules (SCXML) decide what is entered and
left.
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
    """A statechart by the definition that a subclass makes: it calls the steps ``enter`` and
    ``exit`` of its states.
    """

    def __init__(self, states: Sequence[S]) -> None:
        """*states*: all, in the order in which they are written."""
        self._names = {state: f"s{number}" for number, state in enumerate(states)}
        self._chart: Any = None

    def _compile(self, definition: dict[str, Any]) -> None:
        self._class: Any = create_machine_class_from_definition(
            "Machine",
            definition,
            catch_errors_as_events=False,  # they stop the machine
            # how a machine is checked is said in soundness.py, in words of those who write one
            validate_trap_states=False,
            validate_disconnected_states=False,
            validate_final_reachability=False,
        )
        for order, state in enumerate(_in_order(self._class.states), 1):
            state.document_order = order  # the library counts brothers of a container anew (3.2)

    def begin(self) -> None:
        """Enter the first states. One that has ended is made anew; that takes ten times as long as
        to begin again.
        """
        if self._chart is None or self._chart.is_terminated:
            self._chart = self._class()
        else:
            self._chart.current_state_value = None
            self._chart.activate_initial_state()

    def send(self, event: str) -> None:
        """Let an event lead where it does; and then what follows from that without any."""
        self._chart.send(event)

    @property
    def active(self) -> list[S]:
        """The active states, in the order in which they are written."""
        names = self._active_names
        return [state for state, name in self._names.items() if name in names]

    @property
    def _active_names(self) -> Any:
        assert self._chart is not None, "begin() comes first"
        return self._chart.configuration_values


def _in_order(states: Any) -> Iterator[Any]:
    for state in states:
        yield state
        yield from _in_order(state.states)


class LibraryInterpreter(LibraryChart[S], Generic[S, A]):
    """A machine of events at work. A leaf is an atomic state and a compound a compound state, with
    their final states.

    It runs to completion: the end of a compound may follow from an event, and that of another from
        that.
    """

    def __init__(self, states: Sequence[S]) -> None:
        super().__init__(states)
        events = dict.fromkeys(arrow.event for state in states for arrow in state.arrows)
        self._events = {
            event: f"e{number}" for number, event in enumerate(events)
        }  # users' may have any name
        self._now: Any = None
        self._taken: list[A] = []
        tops = [state for state in states if state.parent not in self._names]
        self._compile(
            {self._names[state]: self._defined(state, is_first=state is tops[0]) for state in tops}
        )

    def take(self, event: str, now: Any = None) -> Sequence[A]:
        """Tell it of an event; guards look at *now*. The arrows that were taken."""
        self._now, self._taken = now, []
        if event in self._events:
            self.send(self._events[event])
        return self._taken

    # --- its definition ---------------------------------------------------------------------------

    def _defined(self, state: State[S, A], *, is_first: bool) -> dict[str, Any]:
        is_end_of_compound = state.kind is StateKind.FINAL and state.parent in self._names
        defined: dict[str, Any] = {"initial": is_first, "final": is_end_of_compound}
        defined |= {"enter": state.entry, "exit": state.exit}
        if state.children:
            defined["states"] = {
                self._names[child]: self._defined(child, is_first=child is state.children[0])
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
            "cond": lambda: arrow.holds(self._now),
            "on": lambda: self._taken.append(arrow),
        }
