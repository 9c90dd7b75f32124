"""A machine as a statechart of python-statemachine, whose rules decide which arrow an event takes.

A leaf is an atomic state and a compound a compound state, with their final states as they are written. Events of the
user may have any name, and get numbers here.
"""

from typing import Any, NamedTuple

from tca_behaviours.coordination.model.situation import Situation
from tca_behaviours.coordination.model.states import DONE, AuthoredArrow, AuthoredState, CompoundState
from tca_wire.coordination import ActivityKind
from tca_wire.text.missing import missing_package

try:
    from statemachine.io import create_machine_class_from_definition
except ImportError:
    raise ImportError(missing_package("a coordination machine", "python-statemachine", "charts")) from None


class TakenArrow(NamedTuple):
    """A transition from one leaf to another."""

    before: int
    symbol: str
    after: int


class Interpreter:
    """A machine at work. It begins in the leaf that is entered first."""

    def __init__(self, states: list[AuthoredState]) -> None:
        events = dict.fromkeys(arrow.event for state in states for arrow in state.arrows)
        self._events = {event: f"e{number}" for number, event in enumerate(events)}
        self._leaves = {_name(state): state for state in states if not isinstance(state, CompoundState)}
        self._situation = Situation()
        self._taken: list[TakenArrow] = []
        definition: dict[str, Any] = {_name(state): self._defined(state) for state in states if state.parent is None}
        definition[_name(states[0])]["initial"] = True
        made = create_machine_class_from_definition(
            "Coordination",
            definition,
            catch_errors_as_events=False,  # they stop the machine
            # how a machine is checked is said in soundness.py, in words of those who write one
            validate_trap_states=False,
            validate_disconnected_states=False,
            validate_final_reachability=False,
        )
        self._chart = made()
        self._first = states[0].leaf.number
        self.current = self._first
        """The current leaf."""

    def restart(self) -> None:
        """Begin anew: to build one for each run would take longer than many a run."""
        self._chart.current_state_value = None
        self._chart.activate_initial_state()
        self.current = self._first

    @property
    def is_ended(self) -> bool:
        """Whether a final state of the whole machine is reached."""
        return self._current_leaf.kind is ActivityKind.FINAL

    def take(self, event: str, situation: Situation) -> list[TakenArrow]:
        """Tell it of an event: "done" and "failed" are those of the current activity. The arrows that were taken: none
        if nothing leads on by this event as things are; several if a compound has ended by that.
        """
        self._situation, self._taken = situation, []
        name = self._events.get(event)
        if name is not None:
            self._chart.send(f"{name}_{self.current}" if event == DONE else name)
        return self._taken

    @property
    def _current_leaf(self) -> AuthoredState:
        return next(self._leaves[name] for name in self._chart.configuration_values if name in self._leaves)

    # --- its definition --------------------------------------------------------------------------------------------

    def _defined(self, state: AuthoredState) -> dict[str, Any]:
        is_end_of_compound = state.kind is ActivityKind.FINAL and state.parent is not None
        defined: dict[str, Any] = {"final": True} if is_end_of_compound else {}  # a chart that has ended can't restart
        if isinstance(state, CompoundState):
            defined["states"] = {_name(child): self._defined(child) for child in state.children}
            defined["states"][_name(state.children[0])]["initial"] = True
        on: dict[str, list[dict[str, Any]]] = {}
        for arrow in state.arrows:
            on.setdefault(self._name_of_event(arrow), []).append(self._transition(arrow))
        return defined | {"on": on}

    def _name_of_event(self, arrow: AuthoredArrow) -> str:
        """The end of a state's own activity, or of a compound, is an event of its own: it is nobody else's."""
        if arrow.event != DONE:
            return self._events[arrow.event]
        if isinstance(arrow.source, CompoundState):
            return f"done.state.{_name(arrow.source)}"
        return f"{self._events[DONE]}_{arrow.source.number}"

    def _transition(self, arrow: AuthoredArrow) -> dict[str, Any]:
        return {
            "target": _name(arrow.target),
            "cond": lambda: arrow.holds(self._situation),
            "on": lambda: self._note(arrow),
        }

    def _note(self, arrow: AuthoredArrow) -> None:
        after = arrow.target.leaf.number
        self._taken.append(TakenArrow(self.current, arrow.symbol, after))
        self.current = after


def _name(state: AuthoredState) -> str:
    return f"s{state.number}"
