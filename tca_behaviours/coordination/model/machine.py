"""A machine of activities, as it is written.

with Coordination("deliver", facts={...}) as deliver:
    fetch = deliver.state("fetch", Activity(...))
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from tca_behaviours.coordination.model.activities import FACTS, Activity, Agent
from tca_behaviours.coordination.model.automaton import FlatAutomaton
from tca_behaviours.coordination.model.interpreter import Interpreter
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.model.soundness import check_machine
from tca_behaviours.coordination.model.states import DONE, FAILED, AuthoredArrow, AuthoredState
from tca_behaviours.statecharts.writing import BlockMachine
from tca_module import Variable
from tca_module.checks import check, instance_of
from tca_tools.drawing.chart_dot import chart_dot, likely_arrows, report_marks
from tca_wire.charts import MachineChart, StateKind
from tca_wire.coordination import CoordinationReport

_ACTIVITY_OR_NONE = instance_of("an Activity(Do(...))", Activity).or_none()


class Coordination(BlockMachine[AuthoredState]):
    """A machine whose states have activities. The first state is entered first.

    States are written inside its ``with`` block, and checked at the end of the block.

    Args:
        name: the machine's name.
        facts: the facts that hold at the start.
        watch: variables that functions read: guards, costs, likelihoods. A variable that is itself
            a guard, or is in a Perceived, need not be listed.

    Raises:
        UnsoundMachine: the machine can't be run as it is written. Raised at the end of the block.

    Example::

        with Coordination("deliver") as deliver:
            drive = deliver.state("drive", Activity(Do(DRIVE, "table", BASE)))
            grasp = deliver.state("grasp", Activity(Do(GRASP, "cup", ARM)))
            drive.to(grasp)
            grasp.to(deliver.final("delivered"))
    """

    def __init__(
        self,
        name: str,
        *,
        facts: Mapping[str, Fact] | None = None,
        watch: Iterable[Variable[Any]] = (),
    ) -> None:
        super().__init__(name, AuthoredState(StateKind.COMPOUND, name, None))
        check(self, FACTS, facts=facts or {})
        self.facts = dict(facts or {})
        """The facts that hold at the start."""
        self._watch = list(watch)

    def __repr__(self) -> str:
        return f"machine '{self.name}'"

    # --- states -----------------------------------------------------------------------------------

    def state(self, label: str, activity: Activity | None = None) -> AuthoredState:
        """Add a state with an activity; without one, a state that waits for an event.

        Args:
            label: the state's label, unique in the machine.
            activity: what the robot does in the state.

        Returns:
            The state; its ``to`` adds transitions.
        """
        check(f"state {label!r:.60}", _ACTIVITY_OR_NONE, activity=activity)
        kind = StateKind.WAIT if activity is None else StateKind.ACTIVITY
        return self._register(AuthoredState(kind, label, self._container_for(label), activity))

    def final(self, label: str) -> AuthoredState:
        """Add a final state.

        It ends the compound in which it is written, or the machine if there is none.

        Args:
            label: the state's label, unique in the machine.

        Returns:
            The state.
        """
        return self._register(AuthoredState(StateKind.FINAL, label, self._container_for(label)))

    def compound(self, label: str) -> AuthoredState:
        """Add a state that holds the states written inside its ``with`` block.

        Its arrows apply in all of these states. An arrow for "done" is different: it is taken when
        a final state inside is reached.

        Args:
            label: the state's label, unique in the machine.

        Returns:
            The state.
        """
        return self._register(AuthoredState(StateKind.COMPOUND, label, self._container_for(label)))

    # --- the whole machine ------------------------------------------------------------------------

    @property
    def agents(self) -> list[Agent]:
        """The agents of the machine's activities, in writing order."""
        tasks = [task for state in self.states if state.activity for task in state.activity.tasks]
        return list(dict.fromkeys(agent for task in tasks for agent in task.agents))

    @property
    def _arrows(self) -> list[AuthoredArrow]:
        return [arrow for state in self.states for arrow in state.arrows]

    @property
    def events(self) -> set[str]:
        """The events that come from outside: those of all arrows but "done", "failed" and
        times.
        """
        return {arrow.event for arrow in self._arrows if arrow.after is None} - {DONE, FAILED}

    @property
    def variables(self) -> list[Variable[Any]]:
        """The variables that the machine reads."""
        of_arrows = [variable for arrow in self._arrows for variable in arrow.variables]
        return list({variable.name: variable for variable in (*self._watch, *of_arrows)}.values())

    @property
    def chart(self) -> MachineChart:
        """The structure of the machine as data.

        Raises:
            MisuseError: the machine is being written.
        """
        agents = [agent.name for agent in self.agents]
        return replace(super().chart, is_coordinated=True, agents=agents)

    def automaton(self, situation: Situation, mistakes: Mistakes | None = None) -> FlatAutomaton:
        """Return the machine with its likelihoods in a situation.

        Args:
            situation: the situation.
            mistakes: receives the errors of functions. Default: None, a new object.

        Returns:
            The automaton.

        Raises:
            MisuseError: the machine is being written.
        """
        return FlatAutomaton(self.states, situation, mistakes or Mistakes())

    def interpreter(self) -> Interpreter:
        """Return a new interpreter of the machine, in its first state."""
        return Interpreter(self.states)

    def draw(self, path: str | Path, report: CoordinationReport | None = None) -> None:
        """Draw the machine into a file.

        Args:
            path: the file; its ending says the format: .svg, .png, .pdf or .dot.
            report: a report of a run. The current state is green; foreseen states are yellow, with
                their likelihoods.

        Raises:
            MisuseError: the file can't be drawn or written.
        """
        marks = {} if report is None else report_marks(report)
        likely = None if report is None else likely_arrows(self.chart, report)
        self._draw(path, chart_dot(self.chart, marks, likely))

    def _numbered(self) -> list[AuthoredState]:
        return list(self.root.all())[1:]  # the root is not a state of the chart

    def _check(self, states: list[AuthoredState]) -> None:
        check_machine(states, self.facts)
