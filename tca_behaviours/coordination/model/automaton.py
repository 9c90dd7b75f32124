"""A machine as a flat probabilistic automaton: its states are leaves, its arrows have likelihoods.

The arrows of a state are evaluated on first use, because a preview visits few states.
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
    """A transition from a leaf, with its likelihood."""

    symbol: str
    target: int
    """The leaf that is entered."""
    likelihood: float


class Automaton(Protocol):
    """The part of a machine that a preview reads. A state is a leaf's number, as in the chart."""

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        """Return the transitions of a leaf.

        Args:
            state: the leaf's number.

        Returns:
            The transitions, in their order. The sum of their likelihoods is at most 1.
        """

    def activity(self, state: int) -> Activity | None:
        """Return the activity of a leaf.

        Args:
            state: the leaf's number.

        Returns:
            The activity; None if the leaf has none.
        """

    def waits(self, state: int) -> bool:
        """Return whether the machine waits for an event in a leaf.

        The machine leaves any other leaf without an activity at once.

        Args:
            state: the leaf's number.
        """


def remainder_arrow(arrows: Sequence[AuthoredArrow]) -> AuthoredArrow | None:
    """Return the remainder arrow of a state, if any. Its likelihood is 1 minus the sum of all
    others.

    The candidates are the arrows for "done". If there are none and some arrow has a likelihood, the
    candidates are all arrows except those for "failed". If exactly one candidate has no likelihood
    of its own, that is the remainder arrow.
    """
    candidates = [arrow for arrow in arrows if arrow.event == DONE]
    if not candidates and any(arrow.model for arrow in arrows):
        candidates = [arrow for arrow in arrows if arrow.event != FAILED]
    without_model = [arrow for arrow in candidates if arrow.model is None]
    return without_model[0] if len(without_model) == 1 else None


class FlatAutomaton:
    """The automaton of a machine in one situation."""

    def __init__(
        self, states: Sequence[AuthoredState], situation: Situation, mistakes: Mistakes
    ) -> None:
        self._states = states
        self._mistakes = mistakes
        self._situation = situation
        self._evaluated: dict[int, list[LikelyArrow]] = {}

    @property
    def initial(self) -> int:
        """The leaf that is entered first."""
        return self._states[0].leaf.number

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        """Return the transitions of a leaf.

        Args:
            state: the leaf's number.

        Returns:
            The transitions, in their order. The sum of their likelihoods is at most 1.
        """
        if state not in self._evaluated:
            leaf = self._states[state]
            arrows = arrows_of(leaf)
            self._evaluated[state] = [
                LikelyArrow(arrow.symbol, arrow.target.leaf.number, likelihood)
                for arrow, likelihood in zip(arrows, self._likelihoods(leaf, arrows), strict=True)
            ]
        return self._evaluated[state]

    def activity(self, state: int) -> Activity | None:
        """Return the activity of a leaf.

        Args:
            state: the leaf's number.

        Returns:
            The activity; None if the leaf has none.
        """
        return self._states[state].activity

    def waits(self, state: int) -> bool:
        """Return whether the machine waits for an event in a leaf.

        The machine leaves any other leaf without an activity at once.

        Args:
            state: the leaf's number.
        """
        return self._states[state].kind is StateKind.WAIT

    def _likelihoods(self, leaf: AuthoredState, arrows: list[AuthoredArrow]) -> list[float]:
        """Return the likelihoods of all arrows of a leaf. All are 0 if any of them is unknown."""
        found = []
        consequence = f"nothing is foreseen beyond '{leaf.label}'"
        for arrow in arrows:
            evaluate = partial(self._modelled, leaf, arrow)
            value = self._mistakes.value_or(None, consequence, evaluate)
            if value is None:
                return [0.0] * len(arrows)
            found.append(value)
        total = fsum(found)
        if total > 1:
            return [value / total for value in found]
        if (rest := remainder_arrow(arrows)) is not None:
            found[arrows.index(rest)] = 1 - total
        return found

    def _modelled(self, leaf: AuthoredState, arrow: AuthoredArrow) -> float | None:
        """Return the likelihood of an arrow by its model: 0 without a model, None if the model
        knows none.
        """
        if arrow.model is None:
            return 0.0
        value = arrow.model.value(self._situation, leaf.label, arrow.symbol)
        if value is None:
            return None
        return checked_likelihood(value, f"the likelihood of '{arrow.symbol}'")
