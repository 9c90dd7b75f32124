"""A machine as a statechart of python-statemachine.

The library's rules decide which states are entered and left:

- A task is an atomic state. The event ``ended.s3.failed`` leads out of it.
- A container is a compound state with a final state for each ending. The event ``done.state.s1``
  leads out of the compound state, with a target for each ending.
- A concurrence is a parallel state. Each state in it has a region of its own, so that it can start
  again without the others. With "any", the first ending of a state leads out of the whole
  concurrence. With "all", a region in its final state waits for the other regions.
"""

from collections.abc import Callable
from typing import Any

from tca_behaviours.missions.charts.states import ENDINGS, MachineState
from tca_behaviours.statecharts.library import LibraryChart
from tca_wire.charts import Ending, StateKind

Callback = Callable[[MachineState], object]


class Statechart(LibraryChart[MachineState]):
    """The statechart of one machine. It calls *on_enter* with each state that it enters, and
    *on_exit* with each state that it leaves, one at a time.
    """

    def __init__(self, root: MachineState, on_enter: Callback, on_exit: Callback) -> None:
        super().__init__(list(root.all()))
        self._on_enter, self._on_exit = on_enter, on_exit
        definition: dict[str, Any] = {self._names[root]: self._definition_of(root, is_first=True)}
        definition |= {f"end_{ending}": {"final": True} for ending in ENDINGS}
        self._compile(definition)

    def record_end(self, state: MachineState, ending: Ending) -> None:
        """Leave an active state whose task has ended, and enter the states that follow."""
        self.send(_event(self._names[state], ending))

    @property
    def ending(self) -> Ending | None:
        """How the machine has ended; None while it runs."""
        names = self._active_names
        return next((ending for ending in ENDINGS if f"end_{ending}" in names), None)

    # --- the definition for the library -----------------------------------------------------------

    def _definition_of(self, state: MachineState, *, is_first: bool) -> dict[str, Any]:
        name = self._names[state]
        defined: dict[str, Any] = {
            "initial": is_first,
            "enter": lambda: self._on_enter(state),
            "exit": lambda: self._on_exit(state),
        }
        targets = {ending: self._target_name(state, ending) for ending in ENDINGS}
        match state.kind:
            case StateKind.TASK:
                defined["on"] = {
                    _event(name, ending): [{"target": to}] for ending, to in targets.items()
                }
            case StateKind.EPSILON:
                defined["transitions"] = [{"target": targets["completed"]}]
            case StateKind.ANY | StateKind.ALL:
                defined["parallel"] = True
                defined["states"] = {
                    f"{self._names[child]}_region": self._region(child) for child in state.children
                }
                defined["on"] = {f"done.state.{name}": [{"target": targets["completed"]}]}
            case _:
                first = state.children[0]
                inner = {
                    self._names[child]: self._definition_of(child, is_first=child is first)
                    for child in state.children
                }
                defined["states"] = inner | {
                    f"{name}_{ending}": _final(ending) for ending in ENDINGS
                }
                ended = [
                    {"target": to, "cond": _make_condition(ending)}
                    for ending, to in targets.items()
                ]
                defined["on"] = {f"done.state.{name}": ended}
        return defined

    def _region(self, branch: MachineState) -> dict[str, Any]:
        name = self._names[branch]
        return {
            "states": {
                name: self._definition_of(branch, is_first=True),
                f"{name}_done": {"final": True},
            }
        }

    def _target_name(self, state: MachineState, ending: Ending) -> str:
        """Return the library's name of the target of an ending.

        The target is the state that follows, or else a final state of a container.
        """
        target, parent = state.target(ending), state.parent
        if target is not None:
            return self._names[target]
        if parent is None:
            return f"end_{ending}"
        if not parent.kind.is_concurrent:
            return f"{self._names[parent]}_{ending}"
        if parent.kind is StateKind.ALL and ending == "completed":
            return f"{self._names[state]}_done"
        return self._target_name(parent, ending)


def _event(name: str, ending: Ending) -> str:
    """Return the event for the end of a state's task."""
    return f"ended.{name}.{ending}"


def _final(ending: Ending) -> dict[str, Any]:
    return {"final": True, "donedata": lambda: {"outcome": ending}}


def _make_condition(ending: Ending) -> Callable[[str], bool]:
    return lambda outcome: outcome == ending
