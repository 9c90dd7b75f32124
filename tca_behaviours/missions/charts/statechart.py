"""A machine as a statechart of python-statemachine.

The library's rules decide which states are entered and left:

- A task or a Python state is an atomic state. The event ``ended.s3.1`` leads out of it, by the
  number of its ending.
- A container is a compound state with a final state for each ending. The event ``done.state.s1``
  leads out of the compound state, with a target for each ending.
- A concurrence is a parallel state. Each state in it has a region of its own, so that it can start
  again without the others. An ending of the state leads to a final state of the region. Then the
  policy of the concurrence says whether the concurrence has ended, and as what.
- The event ``after.s3`` leads out of a state in which the machine has been for a time.
"""

from collections.abc import Callable
from typing import Any

from tca_behaviours.missions.charts.states import ENDINGS, MachineState
from tca_behaviours.missions.charts.user_data import log_error
from tca_behaviours.statecharts.library import LibraryChart
from tca_behaviours.statecharts.states import name_of
from tca_module import MisuseError
from tca_wire.charts import StateKind

Callback = Callable[[MachineState], object]


class Statechart(LibraryChart[MachineState]):
    """The statechart of one machine. It calls *on_enter* with each state that it enters, and
    *on_exit* with each state that it leaves, one at a time.
    """

    def __init__(self, root: MachineState, on_enter: Callback, on_exit: Callback) -> None:
        super().__init__(list(root.all()))
        self._on_enter, self._on_exit = on_enter, on_exit
        own = [outcome for state in root.all() for outcome in state.outcomes]
        self._numbers = {
            ending: number for number, ending in enumerate(dict.fromkeys([*ENDINGS, *own]))
        }
        """The numbers of all endings: the library allows only some characters in names."""
        self._ended: dict[MachineState, dict[str, str]] = {}
        """The endings of the states in a concurrence, by label, since it was entered."""
        self._decided: dict[MachineState, str | None] = {}
        """The ending of a concurrence; None while it continues."""
        self._causes: dict[MachineState, str] = {}
        """The event that led to the last ending of a state in a concurrence."""
        self.cause = ""
        """The event that led to the last ending."""
        definition: dict[str, Any] = {self._names[root]: self._definition_of(root, is_first=True)}
        definition |= {f"end{number}": {"final": True} for number in self._numbers.values()}
        self._compile(definition)

    def record_end(self, state: MachineState, ending: str, event: str = "") -> None:
        """Leave an active state that has ended by *event*, and enter the states that follow."""
        self.cause = event
        self.send(self._event(state, ending))

    def record_time(self, state: MachineState, event: str = "") -> None:
        """Leave an active state because of its time, and enter the states that follow."""
        self.cause = event
        self.send(f"after.{self._names[state]}")

    @property
    def ending(self) -> str | None:
        """How the machine has ended; None while it runs."""
        names = self._active_names
        return next(
            (ending for ending, number in self._numbers.items() if f"end{number}" in names), None
        )

    # --- the definition for the library -----------------------------------------------------------

    def _definition_of(self, state: MachineState, *, is_first: bool) -> dict[str, Any]:
        name = self._names[state]
        defined: dict[str, Any] = {
            "initial": is_first,
            "enter": lambda: self._enter(state),
            "exit": lambda: self._on_exit(state),
        }
        targets = {
            ending: self._target_name(state, state.follower(ending)) for ending in self._numbers
        }
        match state.kind:
            case StateKind.TASK | StateKind.CALL:
                defined["on"] = {
                    self._event(state, ending): [{"target": to}] for ending, to in targets.items()
                }
            case StateKind.EPSILON:
                defined["transitions"] = [{"target": targets["completed"]}]
            case kind if kind.is_concurrent:
                regions = {f"{self._names[child]}_region": child for child in state.children}
                decided = [
                    {"target": to, "cond": self._make_decided(state, ending)}
                    for ending, to in targets.items()
                ]
                defined["parallel"] = True
                defined["states"] = {
                    region: self._region(child) for region, child in regions.items()
                }
                defined["on"] = {f"done.state.{region}": decided for region in regions}
            case _:
                first = state.children[0]
                inner = {
                    self._names[child]: self._definition_of(child, is_first=child is first)
                    for child in state.children
                }
                defined["states"] = inner | {
                    f"{name}_end{number}": _final(ending)
                    for ending, number in self._numbers.items()
                }
                ended = [
                    {"target": to, "cond": _make_condition(ending)}
                    for ending, to in targets.items()
                ]
                defined["on"] = {f"done.state.{name}": ended}
        if state.timed is not None:
            to = self._target_name(state, state.timed.end)
            defined.setdefault("on", {})[f"after.{name}"] = [{"target": to}]
        return defined

    def _enter(self, state: MachineState) -> None:
        self._ended[state], self._decided[state] = {}, None
        self._on_enter(state)

    def _event(self, state: MachineState, ending: str) -> str:
        """Return the event for an ending of a state."""
        return f"ended.{self._names[state]}.{self._numbers[ending]}"

    def _region(self, branch: MachineState) -> dict[str, Any]:
        name = self._names[branch]
        finals = {
            f"{name}_out{number}": {"final": True, "enter": self._make_decide(branch, ending)}
            for ending, number in self._numbers.items()
        }
        return {"states": {name: self._definition_of(branch, is_first=True), **finals}}

    def _make_decide(self, branch: MachineState, ending: str) -> Callable[[], None]:
        """Return a function that records the ending of a state in a concurrence."""

        def decide() -> None:
            concurrence = branch.parent
            assert concurrence is not None
            assert concurrence.policy is not None
            ended, branches = self._ended[concurrence], concurrence.children
            ended[branch.label], self._causes[branch] = ending, self.cause
            try:
                decided = concurrence.policy.ending(ended, len(branches))
            except Exception as error:  # noqa: BLE001 - an error of the user's function
                until = concurrence.policy.until
                what = f"until={until and name_of(until)} of {concurrence!r}"
                log_error(what, error)
                raise MisuseError(f"{what} raised {type(error).__name__}: {error}") from None
            self._decided[concurrence] = decided
            first = next((label for label in ended if ended[label] == decided), "")
            if decided != "completed" and first:
                self.cause = self._causes[next(one for one in branches if one.label == first)]

        return decide

    def _make_decided(self, concurrence: MachineState, ending: str) -> Callable[[], bool]:
        return lambda: self._decided[concurrence] == ending

    def _target_name(self, state: MachineState, to: MachineState | str) -> str:
        """Return the library's name of what follows a state: a state, or a final state."""
        if isinstance(to, MachineState):
            return self._names[to]
        number, parent = self._numbers[to], state.parent
        if parent is None:
            return f"end{number}"
        if parent.kind.is_concurrent:
            return f"{self._names[state]}_out{number}"
        return f"{self._names[parent]}_end{number}"


def _final(ending: str) -> dict[str, Any]:
    return {"final": True, "donedata": lambda: {"outcome": ending}}


def _make_condition(ending: str) -> Callable[[str], bool]:
    return lambda outcome: outcome == ending
