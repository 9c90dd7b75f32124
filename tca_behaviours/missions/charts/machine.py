"""State machines of mission tasks, as they are written: ``with Sequence("patrol") as sm:
sm.GoTo(goal_x=1.0)``.
"""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, ClassVar, Literal

from tca_behaviours.missions.charts.running import run_as_task
from tca_behaviours.missions.charts.soundness import endings_of
from tca_behaviours.missions.charts.states import MachineState
from tca_behaviours.missions.client.mission import BaseMission
from tca_behaviours.missions.outcomes import TaskEnd
from tca_behaviours.statecharts.writing import BlockMachine
from tca_module import MisuseError
from tca_module.checks import check, one_of
from tca_tools.drawing.chart_dot import chart_dot
from tca_wire.charts import StateKind

_KINDS = {"any": StateKind.ANY, "all": StateKind.ALL}


class StateMachine(BlockMachine[MachineState]):
    """A state machine of tasks. Only transitions that are written lead from one state to another;
    an ending without one ends the machine. Its states are written inside its ``with`` block, and
    checked at the end of that.

    A state is made by the name of its task: ``sm.GoTo(goal_x=1.0)``, or with a label,
        ``sm.GoTo("home", goal_x=1.0)``.
    """

    _kind: ClassVar[StateKind] = StateKind.MACHINE

    def __init__(self, name: str) -> None:
        super().__init__(name, MachineState(self._kind, name, None))

    def __repr__(self) -> str:
        return repr(self.root)

    # --- states -----------------------------------------------------------------------------------

    def task(self, task: str, label: str = "", /, **parameters: Any) -> MachineState:
        """A state in which a task runs. It has the task's endings."""
        if not isinstance(label, str):
            raise MisuseError(
                f"the label of a state is text, not {label!r:.60}; parameters are given by name"
            )
        state = self._new(StateKind.TASK, label or self._free(task))
        state.task, state.parameters = task, parameters
        return state

    def __getattr__(self, task: str) -> Callable[..., MachineState]:
        if task.startswith("_"):
            raise AttributeError(task)
        return lambda label="", /, **parameters: self.task(task, label, **parameters)

    def epsilon(self, label: str = "", /) -> MachineState:
        """A state that does nothing and has completed at once: where paths meet, or a name for a
        way out.
        """
        return self._new(StateKind.EPSILON, label or self._free("epsilon"))

    def sequence(self, label: str = "", /) -> MachineState:
        """States that follow one another in the order in which they are written, as long as they
        complete.
        """
        return self._new(StateKind.SEQUENCE, label or self._free("sequence"))

    def machine(self, label: str = "", /) -> MachineState:
        """A machine inside: it begins with its first state, and only written transitions lead to
        another.
        """
        return self._new(StateKind.MACHINE, label or self._free("machine"))

    def concurrence(
        self, label: str = "", /, *, until: Literal["any", "all"] = "any"
    ) -> MachineState:
        """States that run together. *any*: until one has ended; its ending is that of all. *all*:
        until all have completed, or one has ended otherwise. Those that still run then are stopped.
        One of them at most has tasks in the foreground.
        """
        return self._new(_concurrence(until), label or self._free("concurrence"))

    def _new(self, kind: StateKind, label: str) -> MachineState:
        return self._added(MachineState(kind, label, self._place(label)))

    def _free(self, default: str) -> str:
        label, number = default, 1
        while label in self._labelled:
            number += 1
            label = f"{default} {number}"
        return label

    # --- the whole --------------------------------------------------------------------------------

    def run(self, mission: BaseMission) -> TaskEnd:
        """Run it as a task of the mission, and wait until it has ended. Raises MissionTaskFailed if
        it did not complete; and UnknownTask or BadParameter, before anything begins, if the server
        has no such task.

        Whatever ends the wait (Ctrl-C, a condition of the mission, an error) stops all its tasks.
        """
        return run_as_task(self.root, self.chart, mission)

    def draw(self, path: str | Path, *, active: Collection[int] = ()) -> None:
        """Draw it into a file, .svg, .png, .pdf or .dot. States whose numbers are in *active* stand
        out. Raises MisuseError if that can't be done.
        """
        self._draw(path, chart_dot(self.chart, dict.fromkeys(active, "active")))

    def _check(self, _states: list[MachineState]) -> None:
        for state, endings in endings_of(self.root).items():
            state.endings = endings


class Sequence(StateMachine):
    """A machine whose states follow one another in the order in which they are written, as long as
    they complete.
    """

    _kind = StateKind.SEQUENCE


class Concurrence(StateMachine):
    """A machine whose states run together, until *any* has ended, or *all* have completed."""

    def __init__(self, name: str, *, until: Literal["any", "all"] = "any") -> None:
        super().__init__(name)
        self.root.kind = _concurrence(until)


def _concurrence(until: str) -> StateKind:
    check("a concurrence", one_of("'any' or 'all'", _KINDS), until=until)
    return _KINDS[until]
