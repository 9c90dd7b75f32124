"""State machines of mission tasks, as they are written: ``with Sequence("patrol") as sm: sm.GoTo(goal_x=1.0)``."""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from tca_behaviours.missions.charts.own_task import run_as_task
from tca_behaviours.missions.charts.soundness import endings_of
from tca_behaviours.missions.charts.states import ENDINGS, ContainerState, MachineState, UnsoundMachine
from tca_behaviours.missions.client.mission import BaseMission
from tca_behaviours.missions.outcomes import TaskEnd
from tca_module import MisuseError
from tca_tools.drawing.chart_dot import chart_dot
from tca_tools.drawing.picture_file import write_machine
from tca_tools.errors import raised_as
from tca_wire.charts import ChartState, MachineChart, StateKind

_LONGEST = 200
"""Characters that the structure has of a parameter."""
_KINDS = {"any": StateKind.ANY, "all": StateKind.ALL}


class StateMachine:
    """A state machine of tasks. Only transitions that are written lead from one state to another; an ending without one
    ends the machine. Its states are written inside its ``with`` block, and checked at the end of that.

    A state is made by the name of its task: ``sm.GoTo(goal_x=1.0)``, or with a label, ``sm.GoTo("home", goal_x=1.0)``.
    """

    _kind: ClassVar[StateKind] = StateKind.MACHINE

    def __init__(self, name: str) -> None:
        if not isinstance(name, str) or not name.strip():
            raise MisuseError(f"a machine needs a name, not {name!r:.60}")
        self.name = name
        self._written: list[ContainerState] = []
        self.root = ContainerState(self._kind, name, None, self._written)
        """The container that is the whole machine."""
        self._labelled: dict[str, MachineState] = {}
        self._chart: MachineChart | None = None

    def __repr__(self) -> str:
        return repr(self.root)

    def __enter__(self) -> Self:
        self.root.__enter__()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.root.__exit__()
        if kind is None:
            self._build()

    # --- states ----------------------------------------------------------------------------------------------------

    def task(self, task: str, label: str = "", /, **parameters: Any) -> MachineState:
        """A state in which a task runs. It has the task's endings."""
        state = self._add(StateKind.TASK, label, task)
        state.task, state.parameters = task, parameters
        return state

    def __getattr__(self, task: str) -> Callable[..., MachineState]:
        if task.startswith("_"):
            raise AttributeError(task)
        return lambda label="", /, **parameters: self.task(task, label, **parameters)

    def epsilon(self, label: str = "", /) -> MachineState:
        """A state that does nothing and has completed at once: where paths meet, or a name for a way out."""
        return self._add(StateKind.EPSILON, label, "epsilon")

    def sequence(self, label: str = "", /) -> ContainerState:
        """States that follow one another in the order in which they are written, as long as they complete."""
        return self._container(StateKind.SEQUENCE, label, "sequence")

    def machine(self, label: str = "", /) -> ContainerState:
        """A machine inside: it begins with its first state, and only written transitions lead to another."""
        return self._container(StateKind.MACHINE, label, "machine")

    def concurrence(self, label: str = "", /, *, until: Literal["any", "all"] = "any") -> ContainerState:
        """States that run together. *any*: until one has ended; its ending is that of all. *all*: until all have
        completed, or one has ended otherwise. Those that still run then are stopped. One of them at most has tasks in
        the foreground.
        """
        return self._container(_concurrence(until), label, "concurrence")

    def _container(self, kind: StateKind, label: str, default: str) -> ContainerState:
        label, inside = self._checked(label, default)
        state = self._labelled[label] = ContainerState(kind, label, inside, self._written)
        return state

    def _add(self, kind: StateKind, label: str, default: str) -> MachineState:
        label, inside = self._checked(label, default)
        state = self._labelled[label] = MachineState(kind, label, inside)
        return state

    def _checked(self, label: str, default: str) -> tuple[str, ContainerState]:
        """The label of a new state, and the container in which it is written."""
        if not self.root.is_open or not self._written:
            raise MisuseError(f"{self!r}: its states are written inside its with block")
        if not isinstance(label, str):
            raise MisuseError(f"the label of a state is text, not {label!r:.60}; parameters are given by name")
        if label in self._labelled:
            raise UnsoundMachine(f"{self!r} has two states '{label}': give one of them another label")
        return label or self._free(default), self._written[-1]

    def _free(self, default: str) -> str:
        label, number = default, 1
        while label in self._labelled:
            number += 1
            label = f"{default} {number}"
        return label

    # --- the whole -------------------------------------------------------------------------------------------------

    def run(self, mission: BaseMission) -> TaskEnd:
        """Run it as a task of the mission, and wait until it has ended. Raises MissionTaskFailed if it did not
        complete; and UnknownTask or BadParameter, before anything begins, if the server has no such task.

        Whatever ends the wait (Ctrl-C, a condition of the mission, an error) stops all its tasks.
        """
        return run_as_task(self.root, self.chart, mission)

    def draw(self, path: str | Path, *, active: Collection[int] = ()) -> None:
        """Draw it into a file, .svg, .png, .pdf or .dot. States whose numbers are in *active* stand out. Raises
        MisuseError if that can't be done.
        """
        with raised_as(MisuseError):
            write_machine(Path(path), chart_dot(self.chart, active))

    @property
    def chart(self) -> MachineChart:
        """Its structure as data. Raises MisuseError while it is being written."""
        if self._chart is None:
            raise MisuseError(f"{self!r} is not built: that happens at the end of its with block")
        return self._chart

    def _build(self) -> None:
        states = list(self.root.all())
        for state in states:
            state.resolve(self._labelled)
        endings = endings_of(self.root)
        number = {state: at for at, state in enumerate(states)}
        rows = []
        for state in states:
            row = ChartState(
                label=state.label,
                kind=state.kind,
                parent=number[state.parent] if state.parent is not None else -1,
                task=state.task,
                parameters={name: f"{value}"[:_LONGEST] for name, value in state.parameters.items()},
                next={end: number[to] for end in ENDINGS if end in endings[state] and (to := state.target(end))},
                ends=list(endings[state]),
            )
            rows.append(row)
        self._chart = MachineChart(self.name, rows)


class Sequence(StateMachine):
    """A machine whose states follow one another in the order in which they are written, as long as they complete."""

    _kind = StateKind.SEQUENCE


class Concurrence(StateMachine):
    """A machine whose states run together, until *any* has ended, or *all* have completed."""

    def __init__(self, name: str, *, until: Literal["any", "all"] = "any") -> None:
        super().__init__(name)
        self.root.kind = _concurrence(until)


def _concurrence(until: str) -> StateKind:
    if until not in _KINDS:
        raise MisuseError(f"until is 'any' or 'all', not {until!r:.60}")
    return _KINDS[until]
