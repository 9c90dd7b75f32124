"""State machines of mission tasks, as they are written.

with Sequence("patrol") as sm:
    sm.GoTo(goal_x=1.0)
"""

from collections.abc import Callable, Collection, Iterable, Mapping, MutableMapping
from pathlib import Path
from typing import Any, ClassVar

from tca_behaviours.missions.charts.policies import OutcomeMap, Until, declared, policy_of
from tca_behaviours.missions.charts.running import MachineEnd, run_as_task
from tca_behaviours.missions.charts.soundness import endings_of
from tca_behaviours.missions.charts.states import MachineState
from tca_behaviours.missions.charts.user_data import OUTCOMES, UserData
from tca_behaviours.missions.client.base_mission import BaseMission
from tca_behaviours.statecharts.states import name_of
from tca_behaviours.statecharts.writing import BlockMachine
from tca_module import MisuseError
from tca_module.checks import LABEL, TEXT, ArgumentKind, check, check_function, instance_of
from tca_tools.drawing.chart_dot import chart_dot
from tca_wire.charts import StateKind

_MISSION = instance_of("an open Mission", BaseMission)
_DATA = instance_of('a dictionary, such as {"counter": 0}', MutableMapping).or_none()
_REMAP = ArgumentKind(
    'names by name, such as {"inside": "outside"}',
    lambda value: isinstance(value, Mapping) and all(map(LABEL.fits, (*value, *value.values()))),
)


class StateMachine(BlockMachine[MachineState]):
    """A state machine of tasks. It starts with its first state.

    An ending of a state leads to the state that ``on`` names for it. An ending without a successor
    ends the container of the state, or the machine. States are written inside the machine's
    ``with`` block, and checked at its end. ``sm.GoTo(goal_x=1.0)`` adds a state for task GoTo, and
    ``sm.GoTo("home", goal_x=1.0)`` one with the label "home".

    Args:
        name: the name of the machine, in the tree and in pictures.
        outcomes: its own outcomes, besides "completed", "failed", "timeout" and "interrupted".

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

    def __init__(self, name: str, *, outcomes: Iterable[str] = ()) -> None:
        super().__init__(name, MachineState(self._kind, name, None))
        self.root.outcomes = declared(outcomes)

    def __repr__(self) -> str:
        return repr(self.root)

    # --- states -----------------------------------------------------------------------------------

    def task(
        self, task: str, label: str = "", /, *more: object, server: str = "", **parameters: Any
    ) -> MachineState:
        """Add a state in which a task runs: ``sm.task("GoTo", goal_x=1.0)`` is
        ``sm.GoTo(goal_x=1.0)``.

        Args:
            task: the name of the task.
            label: the state's label. Default: the task's name, with a number if another state has
                that label.
            more: nothing: parameters are given by name.
            server: the server that offers the task. Default: that of the mission.
            parameters: the parameters of the task. A ``FromData`` is read when the task begins.

        Returns:
            The state. Its endings are those of the task: completed, failed, timeout, interrupted.
        """
        check(self, LABEL, task=task)
        for value in ([] if isinstance(label, str) else [label]) + list(more):
            raise MisuseError(
                f"sm.{task}() adds a state of task '{task}': give it a label and parameters by "
                f"name, not {value!r:.60}; sm.call(function) adds a Python function"
            )
        check(f"{self!r}: {task}", TEXT, server=server)
        state = self._new(StateKind.TASK, label, task)
        state.task, state.server, state.parameters = task, server, parameters
        return state

    def call(
        self,
        function: Callable[[UserData], str | None],
        label: str = "",
        /,
        *,
        remap: Mapping[str, str] | None = None,
    ) -> MachineState:
        """Add a state that calls a Python function with the user data.

        The machine's thread calls it, and waits for it: work that takes long belongs in a task.

        Args:
            function: takes the UserData, and returns one of its outcomes. ``@state`` declares the
                outcomes; a callable object may have them as ``outcomes``. Default: "completed",
                for which it may return None.
            label: the state's label. Default: the function's name, with a number if another state
                has that label.
            remap: by the name of user data in the function, their name around the state.

        Returns:
            The state. It ends as one of the outcomes, or as failed if the function raises.

        Example::

            sm.call(count, "count").on(again="count", enough="completed")
        """
        check_function(f"{self!r}: call", function, "(data)")
        state = self._new(StateKind.CALL, label, name_of(function))
        outcomes = getattr(function, "outcomes", ("completed",))
        check(state, OUTCOMES, outcomes=outcomes)
        state.function, state.outcomes = function, tuple(outcomes)
        self._set_remap(state, remap)
        return state

    def __getattr__(self, task: str) -> Callable[..., MachineState]:
        if task.startswith("_"):
            raise AttributeError(task)
        return lambda label="", /, *more, **parameters: self.task(task, label, *more, **parameters)

    def epsilon(self, label: str = "", /) -> MachineState:
        """Add a state that does nothing and completes at once. It joins paths or names an exit.

        Args:
            label: the state's label. Default: "epsilon", with a number if another state has that
                label.

        Returns:
            The state.
        """
        return self._new(StateKind.EPSILON, label, "epsilon")

    def sequence(
        self,
        label: str = "",
        /,
        *,
        outcomes: Iterable[str] = (),
        remap: Mapping[str, str] | None = None,
    ) -> MachineState:
        """Add a container whose states follow one another, as long as they complete.

        The states follow in writing order.

        Args:
            label: the state's label. Default: "sequence", with a number if another state has that
                label.
            outcomes: its own outcomes, to which states inside may lead.
            remap: by the name of user data inside, their name around the container.

        Returns:
            The container, whose states are written in its ``with`` block.
        """
        return self._container(StateKind.SEQUENCE, label, "sequence", declared(outcomes), remap)

    def machine(
        self,
        label: str = "",
        /,
        *,
        outcomes: Iterable[str] = (),
        remap: Mapping[str, str] | None = None,
    ) -> MachineState:
        """Add a machine inside this one.

        It starts with its first state, and has only the transitions that are written.

        Args:
            label: the state's label. Default: "machine", with a number if another state has that
                label.
            outcomes: its own outcomes, to which states inside may lead.
            remap: by the name of user data inside, their name around the container.

        Returns:
            The container, whose states are written in its ``with`` block.
        """
        return self._container(StateKind.MACHINE, label, "machine", declared(outcomes), remap)

    def concurrence(
        self,
        label: str = "",
        /,
        *,
        until: Until = "any",
        outcome_map: OutcomeMap | None = None,
        default: str = "",
        outcomes: Iterable[str] = (),
        remap: Mapping[str, str] | None = None,
    ) -> MachineState:
        """Add a container whose states run together. At most one of them may have foreground tasks.

        States that still run when the container ends are stopped.

        Args:
            label: the container's label.
            until: "any": the first ending of a state is the container's ending. "all": the
                container completes when all states have completed; any other ending ends it at
                once. "all ended": it waits for all states; if any did not complete, the first such
                ending is the container's. A function: it is called at each ending with the endings
                so far, by label, and returns True to end the container.
            outcome_map: by outcome: endings of states, by label. The first outcome whose row fits
                is the container's ending. A state that is stopped counts as "interrupted".
            default: the outcome if no row fits. Default: the ending as *until* says.
            outcomes: further outcomes of its own, to which states inside may lead.
            remap: by the name of user data inside, their name around the container.

        Returns:
            The container, whose states are written in its ``with`` block.

        Example::

            with sm.concurrence(
                until="all ended",
                outcome_map={"both": {"Look": "completed", "Listen": "completed"}},
                default="not both",
            ) as search:
                sm.Look()
                sm.Listen(foreground=False)
            search.on(both="Grasp", **{"not both": "Search"})
        """
        policy = policy_of(until, outcome_map, default)
        own = declared(outcomes, policy)
        state = self._container(policy.kind, label, "concurrence", own, remap)
        state.policy = policy
        return state

    def _container(
        self,
        kind: StateKind,
        label: str,
        default: str,
        outcomes: tuple[str, ...],
        remap: Mapping[str, str] | None,
    ) -> MachineState:
        state = self._new(kind, label, default)
        state.outcomes = outcomes
        self._set_remap(state, remap)
        return state

    def _set_remap(self, state: MachineState, remap: Mapping[str, str] | None) -> None:
        if remap is not None:
            check(state, _REMAP, remap=remap)
            state.remap = dict(remap)

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

    def run(
        self, mission: BaseMission, *, data: MutableMapping[str, Any] | None = None
    ) -> MachineEnd:
        """Run the machine as a task of a mission, and wait until it has ended.

        If anything ends the wait, such as Ctrl-C, a condition of the mission, or an error, all
        tasks of the machine are stopped.

        Args:
            mission: the open mission; its server must offer the tasks that name no server.
            data: the user data at the start. The states change this dictionary.

        Returns:
            The end of the machine: its outcome is "completed" or one of its own.

        Raises:
            MissionTaskFailed: the machine did not complete.
            UnknownTask, BadParameter: the server has no such task. Nothing was started.
            NotOffered: a server that a state names did not appear in time. Nothing was started.
        """
        check(f"{self!r}: run()", _MISSION, mission=mission)
        check(f"{self!r}: run()", _DATA, data=data)
        return run_as_task(self.root, self.chart, mission, {} if data is None else data)

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
    """A machine whose states run together.

    Args:
        name: the name of the machine, in the tree and in pictures.
        until: as for ``StateMachine.concurrence``.
        outcome_map: as for ``StateMachine.concurrence``.
        default: the outcome if no row of *outcome_map* fits. Default: the ending as *until* says.
        outcomes: further outcomes of its own.

    Raises:
        UnsoundMachine: the machine can't be run as it is written. Raised at the end of the block.
    """

    def __init__(
        self,
        name: str,
        *,
        until: Until = "any",
        outcome_map: OutcomeMap | None = None,
        default: str = "",
        outcomes: Iterable[str] = (),
    ) -> None:
        super().__init__(name)
        self.root.policy = policy = policy_of(until, outcome_map, default)
        self.root.kind, self.root.outcomes = policy.kind, declared(outcomes, policy)
