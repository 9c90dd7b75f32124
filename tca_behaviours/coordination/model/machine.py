"""A machine of activities, as it is written: ``with Coordination("deliver", facts={...}) as
deliver:``.
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
    """A machine whose states have activities. Its states are written inside its ``with`` block, and
    checked at the end of that; the first one is entered first.

    *facts*: what holds at the start. *watch*: variables that functions read (guards, costs,
        likelihoods), beside those
    that are guards themselves or in Perceived.
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
        """What holds at the start."""
        self._watch = list(watch)

    def __repr__(self) -> str:
        return f"machine '{self.name}'"

    # --- states -----------------------------------------------------------------------------------

    def state(self, label: str, activity: Activity | None = None) -> AuthoredState:
        """A state with an activity; or one without, which waits for an event."""
        check(f"state {label!r:.60}", _ACTIVITY_OR_NONE, activity=activity)
        kind = StateKind.WAIT if activity is None else StateKind.ACTIVITY
        return self._register(AuthoredState(kind, label, self._place(label), activity))

    def final(self, label: str) -> AuthoredState:
        """The end of the compound in which it is written, which is done then; outside of any, that
        of the machine.
        """
        return self._register(AuthoredState(StateKind.FINAL, label, self._place(label)))

    def compound(self, label: str) -> AuthoredState:
        """A state that holds those that are written inside its ``with`` block. Its arrows apply in
        all of them, but for those for "done": they are taken when a final state inside is reached.
        """
        return self._register(AuthoredState(StateKind.COMPOUND, label, self._place(label)))

    # --- the whole --------------------------------------------------------------------------------

    @property
    def agents(self) -> list[Agent]:
        """The agents of its activities, in the order in which they are written."""
        tasks = [task for state in self.states if state.activity for task in state.activity.tasks]
        return list(dict.fromkeys(agent for task in tasks for agent in task.agents))

    @property
    def _arrows(self) -> list[AuthoredArrow]:
        return [arrow for state in self.states for arrow in state.arrows]

    @property
    def events(self) -> set[str]:
        """The events that its arrows name, beside "done" and "failed"."""
        return {arrow.event for arrow in self._arrows} - {DONE, FAILED}

    @property
    def variables(self) -> list[Variable[Any]]:
        """The variables that it looks at."""
        of_arrows = [one for arrow in self._arrows for one in arrow.variables]
        return list({variable.name: variable for variable in (*self._watch, *of_arrows)}.values())

    @property
    def chart(self) -> MachineChart:
        """Its structure as data. Raises MisuseError while the machine is being written."""
        agents = [agent.name for agent in self.agents]
        return replace(super().chart, is_coordinated=True, agents=agents)

    def automaton(self, situation: Situation, mistakes: Mistakes | None = None) -> FlatAutomaton:
        """The machine with its likelihoods in that situation. *mistakes*: takes what their
        functions raise.
        """
        return FlatAutomaton(self.states, situation, mistakes or Mistakes())

    def interpreter(self) -> Interpreter:
        """The machine at work, in its first state."""
        return Interpreter(self.states)

    def draw(self, path: str | Path, report: CoordinationReport | None = None) -> None:
        """Draw it into a file, .svg, .png, .pdf or .dot. With a *report* of a run the current state
        is green, and those that it foresees are yellow, with their likelihoods. Raises MisuseError
        if that can't be done.
        """
        marks, likely = (
            ({}, None)
            if report is None
            else (report_marks(report), likely_arrows(self.chart, report))
        )
        self._draw(path, chart_dot(self.chart, marks, likely))

    def _numbered(self) -> list[AuthoredState]:
        return list(self.root.all())[1:]  # it has no frame around it all

    def _check(self, states: list[AuthoredState]) -> None:
        check_machine(states, self.facts)
