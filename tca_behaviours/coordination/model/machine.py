"""A machine of activities, as it is written: ``with Coordination("deliver", facts={...}) as deliver:``."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self, TypeVar

from tca_behaviours.coordination.model.activities import Activity, Agent, checked_facts
from tca_behaviours.coordination.model.automaton import FlatAutomaton
from tca_behaviours.coordination.model.errors import UnsoundCoordination
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.model.soundness import check
from tca_behaviours.coordination.model.statechart import Interpreter
from tca_behaviours.coordination.model.states import DONE, FAILED, AuthoredArrow, AuthoredState, CompoundState
from tca_module import MisuseError, Variable
from tca_tools.drawing.coordination_dot import coordination_dot
from tca_tools.drawing.picture_file import write_machine
from tca_tools.errors import raised_as
from tca_wire.coordination import (
    ActivityKind,
    CoordinationArrow,
    CoordinationChart,
    CoordinationReport,
    CoordinationState,
)

S = TypeVar("S", bound=AuthoredState)


class Coordination:
    """A machine whose states have activities. Its states are written inside its ``with`` block, and checked at the end
    of that; the first one is entered first.

    *facts*: what holds at the start. *watch*: variables that functions read (guards, costs, likelihoods), beside those
    that are guards themselves or in Perceived.
    """

    def __init__(
        self, name: str, *, facts: Mapping[str, Fact] | None = None, watch: Iterable[Variable[Any]] = ()
    ) -> None:
        if not isinstance(name, str) or not name.strip():
            raise MisuseError(f"a machine needs a name, not {name!r:.60}")
        self.name = name
        self.facts = checked_facts(facts or {}, "facts")
        """What holds at the start."""
        self._watch = list(watch)
        self._top: list[AuthoredState] = []
        self._labelled: dict[str, AuthoredState] = {}
        self._written: list[CompoundState] = []
        self._is_open = False
        self._states: list[AuthoredState] = []

    def __repr__(self) -> str:
        return f"machine '{self.name}'"

    def __enter__(self) -> Self:
        if self._is_open or self._states:
            raise MisuseError(f"{self!r} is written in one with block; make another one")
        self._is_open = True
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self._is_open = False
        if kind is None:
            self._build()

    # --- states ----------------------------------------------------------------------------------------------------

    def state(self, label: str, activity: Activity | None = None) -> AuthoredState:
        """A state with an activity; or one without, which waits for an event."""
        if activity is not None and not isinstance(activity, Activity):
            raise MisuseError(f"state {label!r:.60}: its activity must be an Activity(Do(...)), not {activity!r:.60}")
        parent = self._place(label)
        kind = ActivityKind.WAIT if activity is None else ActivityKind.ACTIVITY
        return self._added(AuthoredState(kind, label, parent, activity))

    def final(self, label: str) -> AuthoredState:
        """The end of the compound in which it is written, which is done then; outside of any, that of the machine."""
        return self._added(AuthoredState(ActivityKind.FINAL, label, self._place(label)))

    def compound(self, label: str) -> CompoundState:
        """A state that holds those that are written inside its ``with`` block. Its arrows apply in all of them, but for
        those for "done": they are taken when a final state inside is reached.
        """
        return self._added(CompoundState(label, self._place(label), self._written))

    def _place(self, label: str) -> CompoundState | None:
        """The compound in which a state of this label is written."""
        if not self._is_open:
            raise MisuseError(f"{self!r}: its states are written inside its with block")
        if not isinstance(label, str) or not label.strip():
            raise MisuseError(f"{self!r}: the label of a state is text, not {label!r:.60}")
        if label in self._labelled:
            raise UnsoundCoordination(f"{self!r} has two states '{label}': give one of them another label")
        return self._written[-1] if self._written else None

    def _added(self, state: S) -> S:
        self._labelled[state.label] = state
        if state.parent is None:
            self._top.append(state)
        return state

    # --- the whole -------------------------------------------------------------------------------------------------

    @property
    def states(self) -> list[AuthoredState]:
        """All states, by their numbers. Raises MisuseError while the machine is being written."""
        if not self._states:
            raise MisuseError(f"{self!r} is not built: that happens at the end of its with block")
        return self._states

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
    def chart(self) -> CoordinationChart:
        """Its structure as data."""
        arrows = [CoordinationArrow(one.source.number, one.target.number, one.symbol) for one in self._arrows]
        return CoordinationChart(self.name, [agent.name for agent in self.agents], list(map(_row, self.states)), arrows)

    def automaton(self, situation: Situation, mistakes: Mistakes | None = None) -> FlatAutomaton:
        """The machine with its likelihoods in that situation. *mistakes*: takes what their functions raise."""
        return FlatAutomaton(self.states, situation, mistakes or Mistakes())

    def interpreter(self) -> Interpreter:
        """The machine at work, in its first state."""
        return Interpreter(self.states)

    def draw(self, path: str | Path, report: CoordinationReport | None = None) -> None:
        """Draw it into a file, .svg, .png, .pdf or .dot. With a *report* of a run the current state is green, and those
        that it foresees are yellow, with their likelihoods. Raises MisuseError if that can't be done.
        """
        with raised_as(MisuseError):
            write_machine(Path(path), coordination_dot(self.chart, report))

    def _build(self) -> None:
        states = [state for top in self._top for state in top.all()]
        if not states:
            raise UnsoundCoordination(f"{self!r} has no state: write them inside its with block")
        for number, state in enumerate(states):
            state.number = number
            for arrow in state.arrows:
                arrow.resolve(self._labelled)
        check(states, self.facts)
        self._states = states


def _row(state: AuthoredState) -> CoordinationState:
    tasks = state.activity.tasks if state.activity is not None else ()
    return CoordinationState(
        label=state.label,
        kind=state.kind,
        parent=state.parent.number if state.parent is not None else -1,
        tasks=[task.text for task in tasks],
        agents=["+".join(agent.name for agent in task.agents) for task in tasks],
    )
