"""State machines of mission tasks, as they are written.

with Sequence("patrol") as sm:
    sm.GoTo(goal_x=1.0)
"""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, ClassVar, Literal

from tca_behaviours.missions.charts.running import run_as_task
from tca_behaviours.missions.charts.soundness import endings_of
from tca_behaviours.missions.charts.states import MachineState
from tca_behaviours.missions.client.base_mission import BaseMission
from tca_behaviours.missions.outcomes import TaskEnd
from tca_behaviours.statecharts.writing import BlockMachine
from tca_module import MisuseError
from tca_module.checks import check, one_of
from tca_tools.drawing.chart_dot import chart_dot
from tca_wire.charts import StateKind

_KINDS = {"any": StateKind.ANY, "all": StateKind.ALL}


class StateMachine(BlockMachine[MachineState]):
    """A state machine of tasks. It starts with its first state.

    An ending of a state leads to the state that ``on`` names for it. An ending without a successor
    ends the container of the state, or the machine. States are written inside the machine's
    ``with`` block, and checked at its end. ``sm.GoTo(goal_x=1.0)`` adds a state for task GoTo, and
    ``sm.GoTo("home", goal_x=1.0)`` one with the label "home".

    Args:
        name: the name of the machine, in the tree and in pictures.

    Raises:
        UnsoundMachine: the machine can't be run as it is written. Raised at the end of the block.

    Example::

        with StateMachine("patrol") as sm:
            there = sm.GoTo("there", goal_x=9.0)
            back = sm.GoTo("back", goal_x=1.0).on(completed=there)
            there.on(completed=back)

        with Mission("turtle") as mission:
            sm.run(mission)
    """

    _kind: ClassVar[StateKind] = StateKind.MACHINE

    def __init__(self, name: str) -> None:
        super().__init__(name, MachineState(self._kind, name, None))

    def __repr__(self) -> str:
        return repr(self.root)

    # --- states -----------------------------------------------------------------------------------

    def task(self, task: str, label: str = "", /, **parameters: Any) -> MachineState:
        """Add a state in which a task runs: ``sm.task("GoTo", goal_x=1.0)`` is
        ``sm.GoTo(goal_x=1.0)``.

        Args:
            task: the name of the task.
            label: the state's label. Default: the task's name, with a number if another state has
                that label.
            parameters: the parameters of the task.

        Returns:
            The state. Its endings are those of the task: completed, failed, timeout, interrupted.
        """
        if not isinstance(label, str):
            raise MisuseError(
                f"the label of a state is text, not {label!r:.60}; parameters are given by name"
            )
        state = self._new(StateKind.TASK, label, task)
        state.task, state.parameters = task, parameters
        return state

    def __getattr__(self, task: str) -> Callable[..., MachineState]:
        if task.startswith("_"):
            raise AttributeError(task)
        return lambda label="", /, **parameters: self.task(task, label, **parameters)

    def epsilon(self, label: str = "", /) -> MachineState:
        """Add a state that does nothing and completes at once. It joins paths or names an exit.

        Args:
            label: the state's label. Default: "epsilon", with a number if another state has that
                label.

        Returns:
            The state.
        """
        return self._new(StateKind.EPSILON, label, "epsilon")

    def sequence(self, label: str = "", /) -> MachineState:
        """Add a container whose states follow one another, as long as they complete.

        The states follow in writing order.

        Args:
            label: the state's label. Default: "sequence", with a number if another state has that
                label.

        Returns:
            The container, whose states are written in its ``with`` block.
        """
        return self._new(StateKind.SEQUENCE, label, "sequence")

    def machine(self, label: str = "", /) -> MachineState:
        """Add a machine inside this one.

        It starts with its first state, and has only the transitions that are written.

        Args:
            label: the state's label. Default: "machine", with a number if another state has that
                label.

        Returns:
            The container, whose states are written in its ``with`` block.
        """
        return self._new(StateKind.MACHINE, label, "machine")

    def concurrence(
        self, label: str = "", /, *, until: Literal["any", "all"] = "any"
    ) -> MachineState:
        """Add a container whose states run together. At most one of them may have foreground tasks.

        Args:
            label: the container's label.
            until: "any": the first ending of a state is the container's ending. "all": the
                container completes when all states have completed; any other ending ends it at
                once. States that still run are then stopped.
        """
        return self._new(_kind_of_concurrence(until), label, "concurrence")

    def _new(self, kind: StateKind, label: str, default: str) -> MachineState:
        """Add a state. Without a *label* the state gets the *default* label, with a number if that
        label is used.
        """
        if not label:
            label, number = default, 1
            while label in self._labelled:
                number += 1
                label = f"{default} {number}"
        return self._register(MachineState(kind, label, self._container_for(label)))

    # --- the whole machine ------------------------------------------------------------------------

    def run(self, mission: BaseMission) -> TaskEnd:
        """Run the machine as a task of a mission, and wait until it has ended.

        If anything ends the wait, such as Ctrl-C, a condition of the mission, or an error, all
        tasks of the machine are stopped.

        Args:
            mission: the open mission; its server must offer the tasks.

        Returns:
            The TaskEnd of the completed machine.

        Raises:
            MissionTaskFailed: the machine did not complete.
            UnknownTask, BadParameter: the server has no such task. Nothing was started.
        """
        return run_as_task(self.root, self.chart, mission)

    def draw(self, path: str | Path, *, active: Collection[int] = ()) -> None:
        """Draw the machine into a file.

        Args:
            path: the file; its ending says the format: .svg, .png, .pdf or .dot.
            active: the numbers of the states to highlight.

        Raises:
            MisuseError: the file can't be drawn or written.
        """
        self._draw(path, chart_dot(self.chart, dict.fromkeys(active, "active")))

    def _check(self, _states: list[MachineState]) -> None:
        for state, endings in endings_of(self.root).items():
            state.endings = endings


class Sequence(StateMachine):
    """A machine whose states follow one another in writing order, as long as they complete."""

    _kind = StateKind.SEQUENCE


class Concurrence(StateMachine):
    """A machine whose states run together, until *any* has ended or *all* have completed."""

    def __init__(self, name: str, *, until: Literal["any", "all"] = "any") -> None:
        super().__init__(name)
        self.root.kind = _kind_of_concurrence(until)


def _kind_of_concurrence(until: str) -> StateKind:
    check("a concurrence", one_of("'any' or 'all'", _KINDS), until=until)
    return _KINDS[until]
