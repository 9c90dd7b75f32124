"""A machine as a flat probabilistic automaton: its states are leaves, and its arrows have
likelihoods.

They are evaluated when a state is looked at, once in each situation: a preview costs what it sees.
"""

from collections.abc import Sequence
from functools import partial
from math import fsum
from typing import NamedTuple, Protocol

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.likelihoods import checked_likelihood
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Situation
from tca_behaviours.coordination.model.states import DONE, FAILED, AuthoredArrow, AuthoredState
from tca_behaviours.statecharts.soundness import arrows_of
from tca_wire.charts import StateKind


class LikelyArrow(NamedTuple):
    """A transition from a leaf, and how likely it is."""

    symbol: str
    target: int
    """The leaf that is entered."""
    likelihood: float


class Automaton(Protocol):
    """What a preview needs of a machine. States are numbers of leaves, as in the chart."""

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        """The transitions of a leaf, in their order. Their likelihoods are 1 together at most."""

    def activity(self, state: int) -> Activity | None:
        """The activity of a leaf, if it has one."""

    def waits(self, state: int) -> bool:
        """Whether the machine waits for an event in a leaf; in another one without an activity it
        does not rest.
        """


def nominal(arrows: Sequence[AuthoredArrow]) -> AuthoredArrow | None:
    """The arrow that gets what the others leave: the only one for "done" without a likelihood.
    Where none is for "done", the only one without, if others have one; not that for "failed".
    """
    done = [arrow for arrow in arrows if arrow.event == DONE]
    others = (
        [arrow for arrow in arrows if arrow.event != FAILED]
        if any(arrow.model for arrow in arrows)
        else []
    )
    unsaid = [arrow for arrow in done or others if arrow.model is None]
    return unsaid[0] if len(unsaid) == 1 else None


class FlatAutomaton:
    """The automaton of a machine in one situation."""

    def __init__(
        self, states: Sequence[AuthoredState], situation: Situation, mistakes: Mistakes
    ) -> None:
        self._states = states
        self._mistakes = mistakes
        self._situation = situation
        self._known: dict[int, list[LikelyArrow]] = {}

    @property
    def initial(self) -> int:
        """The leaf that is entered first."""
        return self._states[0].leaf.number

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        """The transitions of a leaf, in their order. Their likelihoods are 1 together at most."""
        if state not in self._known:
            self._known[state] = self._evaluated(self._states[state])
        return self._known[state]

    def activity(self, state: int) -> Activity | None:
        """The activity of a leaf, if it has one."""
        return self._states[state].activity

    def waits(self, state: int) -> bool:
        """Whether the machine waits for an event in a leaf; in another one without an activity it
        does not rest.
        """
        return self._states[state].kind is StateKind.WAIT

    def _evaluated(self, leaf: AuthoredState) -> list[LikelyArrow]:
        arrows = arrows_of(leaf)
        likelihoods = self._likelihoods(leaf, arrows)
        return [
            LikelyArrow(arrow.symbol, arrow.target.leaf.number, likelihood)
            for arrow, likelihood in zip(arrows, likelihoods, strict=True)
        ]

    def _value(self, leaf: AuthoredState, arrow: AuthoredArrow) -> float | None:
        value = (
            0.0
            if arrow.model is None
            else arrow.model.value(self._situation, leaf.label, arrow.symbol)
        )
        return (
            None
            if value is None
            else checked_likelihood(value, f"the likelihood of '{arrow.symbol}'")
        )

    def _likelihoods(self, leaf: AuthoredState, arrows: list[AuthoredArrow]) -> list[float]:
        found = []
        for arrow in arrows:
            value = self._mistakes.otherwise(
                None,
                f"nothing is foreseen beyond '{leaf.label}'",
                partial(self._value, leaf, arrow),
            )
            if value is None:
                return [0.0] * len(arrows)
            found.append(value)
        total = fsum(found)
        if total > 1:
            return [value / total for value in found]
        if (rest := nominal(arrows)) is not None:
            found[arrows.index(rest)] = 1 - total
        return found
