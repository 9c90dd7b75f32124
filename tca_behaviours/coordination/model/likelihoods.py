"""How likely a transition is: models that are attached to it."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import fsum, inf
from typing import Any

from tca_behaviours.coordination.model.situation import Situation, check_confidence
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_module import MisuseError, Variable
from tca_module.checks import NUMBER, VARIABLE, ArgumentKind, check

_ROUNDING = 1e-9


class LikelihoodModel:
    """The likelihood of a transition. Base class: give ``value``."""

    is_constant = False
    """Whether its number never changes. The constants of one state must not be more than 1
    together.
    """
    variables: Sequence[Variable[Any]] = ()
    """The variables that it looks at."""

    def value(self, situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """The likelihood in [0, 1] that the state *leaf* is left by *symbol*; None if it is
        unknown.
        """
        raise NotImplementedError


class Prior(LikelihoodModel):
    """A number that is known beforehand."""

    is_constant = True

    def __init__(self, likelihood: float) -> None:
        self.likelihood = checked_likelihood(likelihood, "Prior")

    def value(self, _situation: Situation, _leaf: str, _symbol: str, /) -> float | None:
        """The number."""
        return self.likelihood


_COUNTS = ArgumentKind(
    "counts by (label, symbol), as count_transitions makes them",
    lambda counts: isinstance(counts, Mapping) and all(map(NUMBER.fits, counts.values())),
)


class Learned(LikelihoodModel):
    """The share of a transition in earlier runs. *counts*: how often each symbol was taken, by
    (label, symbol). Unknown in a state that was never left.
    """

    def __init__(self, counts: Mapping[tuple[str, str], int]) -> None:
        check("Learned", _COUNTS, counts=counts)
        self.counts = dict(counts)
        self._left: dict[str, int] = {}
        for (label, _), count in self.counts.items():
            self._left[label] = self._left.get(label, 0) + count

    def value(self, _situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """The share of this symbol."""
        times = self._left.get(leaf, 0)
        return self.counts.get((leaf, symbol), 0) / times if times else None


class Perceived(LikelihoodModel):
    """The value of a variable: a bool, or a confidence that is cut to [0, 1]; *negated*: 1 minus
    that. Unknown until it is set.
    """

    def __init__(self, variable: Variable[Any], *, negated: bool = False) -> None:
        check("Perceived", VARIABLE, variable=variable)
        check_confidence(variable, "Perceived")
        self.variables = (variable,)
        self.negated = negated

    def value(self, situation: Situation, _leaf: str, _symbol: str, /) -> float | None:
        """The confidence as it is now."""
        confidence = situation.confidence(self.variables[0])
        return confidence if confidence is None or not self.negated else 1.0 - confidence


class Computed(LikelihoodModel):
    """A function of the Situation."""

    def __init__(self, function: Callable[[Situation], float | None]) -> None:
        self.function = function

    def value(self, situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """The function's number."""
        value = self.function(situation)
        return (
            None
            if value is None
            else checked_likelihood(value, f"the likelihood of '{symbol}' in state '{leaf}'")
        )


Likelihood = LikelihoodModel | Callable[[Situation], float | None]
"""Anything that says how likely a transition is."""

_LIKELIHOOD = ArgumentKind(
    "a model such as Prior(0.8), or a function",
    lambda value: isinstance(value, LikelihoodModel) or callable(value),
)


class Weighted(LikelihoodModel):
    """The mean of several models with weights; those that are unknown are left out of it."""

    def __init__(self, parts: Iterable[tuple[float, Likelihood]]) -> None:
        pairs = list(parts)
        if not pairs or not all(_is_weighted(pair) for pair in pairs):
            raise MisuseError(
                "Weighted wants pairs of a weight above 0 and a model, such as [(2.0, Prior(0.8)), ...]"
            )
        self.parts = [(weight, as_model(model)) for weight, model in pairs]
        self.is_constant = all(model.is_constant for _, model in self.parts)
        self.variables = [variable for _, model in self.parts for variable in model.variables]

    def value(self, situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """The mean of what is known."""
        values = [(weight, model.value(situation, leaf, symbol)) for weight, model in self.parts]
        known = [(weight, value) for weight, value in values if value is not None]
        weights = fsum(weight for weight, _ in known)
        return fsum(weight * value for weight, value in known) / weights if known else None


def _is_weighted(pair: Any) -> bool:
    return (
        isinstance(pair, tuple)
        and len(pair) == 2
        and isinstance(pair[0], int | float)
        and 0 < pair[0] < inf
    )


def as_model(likelihood: Likelihood) -> LikelihoodModel:
    """A model as it is; of a function the model that calls it."""
    check("a transition", _LIKELIHOOD, likelihood=likelihood)
    return likelihood if isinstance(likelihood, LikelihoodModel) else Computed(likelihood)


def checked_likelihood(likelihood: Any, what: str) -> float:
    """It as a number in [0, 1]; what is outside by rounding is cut. Raises UnsoundMachine."""
    if not isinstance(likelihood, int | float) or not -_ROUNDING <= likelihood <= 1 + _ROUNDING:
        raise UnsoundMachine(f"{what} must be a number in [0, 1], not {likelihood!r:.60}")
    return min(max(float(likelihood), 0.0), 1.0)
