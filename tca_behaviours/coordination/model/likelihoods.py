"""Models of the likelihood of a transition."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import fsum, inf
from typing import Any

from tca_behaviours.coordination.model.situation import Situation, check_confidence
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_module import MisuseError, Variable
from tca_module.checks import NUMBER, VARIABLE, ArgumentKind, check

_ROUNDING = 1e-9


class LikelihoodModel:
    """The likelihood of a transition. A subclass defines ``value``."""

    is_constant = False
    """Whether its value never changes. The sum of a state's constant likelihoods must be at most
    1.
    """
    variables: Sequence[Variable[Any]] = ()
    """The variables that the model reads."""

    def value(self, situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """Return the likelihood that a state is left by a transition.

        Args:
            situation: the present situation.
            leaf: the label of the state.
            symbol: the symbol of the transition.

        Returns:
            The likelihood, in [0, 1]; None if it is unknown.
        """
        raise NotImplementedError


class Prior(LikelihoodModel):
    """A constant likelihood.

    Args:
        likelihood: the likelihood, in [0, 1].
    """

    is_constant = True

    def __init__(self, likelihood: float) -> None:
        self.likelihood = checked_likelihood(likelihood, "Prior")

    def value(self, _situation: Situation, _leaf: str, _symbol: str, /) -> float | None:
        """Return the constant."""
        return self.likelihood


_COUNTS = ArgumentKind(
    "counts by (label, symbol), as count_transitions makes them",
    lambda counts: isinstance(counts, Mapping) and all(map(NUMBER.fits, counts.values())),
)


class Learned(LikelihoodModel):
    """The share of a transition in earlier runs; unknown in a state that was never left.

    Args:
        counts: how often each transition was taken, by (label of its state, symbol), as returned by
            ``count_transitions``.
    """

    def __init__(self, counts: Mapping[tuple[str, str], int]) -> None:
        check("Learned", _COUNTS, counts=counts)
        self.counts = dict(counts)
        self._exits: dict[str, int] = {}
        for (label, _), count in self.counts.items():
            self._exits[label] = self._exits.get(label, 0) + count

    def value(self, _situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """Return the share of this symbol.

        Args:
            leaf: the label of the state.
            symbol: the symbol of the transition.
        """
        exits = self._exits.get(leaf, 0)
        return self.counts.get((leaf, symbol), 0) / exits if exits else None


class Perceived(LikelihoodModel):
    """The value of a variable: a bool, or a confidence, which is limited to [0, 1].

    The likelihood is unknown until the variable is set.

    Args:
        variable: the variable, of bool, int or float.
        negated: whether the likelihood is 1 minus the value. Default: False.
    """

    def __init__(self, variable: Variable[Any], *, negated: bool = False) -> None:
        check("Perceived", VARIABLE, variable=variable)
        check_confidence(variable, "Perceived")
        self.variables = (variable,)
        self.negated = negated

    def value(self, situation: Situation, _leaf: str, _symbol: str, /) -> float | None:
        """Return the present confidence.

        Args:
            situation: the present situation.
        """
        confidence = situation.confidence(self.variables[0])
        return confidence if confidence is None or not self.negated else 1.0 - confidence


class Computed(LikelihoodModel):
    """A function of the Situation."""

    def __init__(self, function: Callable[[Situation], float | None]) -> None:
        self.function = function

    def value(self, situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """Return the number that the function returns."""
        value = self.function(situation)
        if value is None:
            return None
        return checked_likelihood(value, f"the likelihood of '{symbol}' in state '{leaf}'")


Likelihood = LikelihoodModel | Callable[[Situation], float | None]
"""A model of a likelihood, or a function of the Situation."""

_LIKELIHOOD = ArgumentKind(
    "a model such as Prior(0.8), or a function",
    lambda value: isinstance(value, LikelihoodModel) or callable(value),
)


class Weighted(LikelihoodModel):
    """The weighted mean of several models. Models whose likelihood is unknown are left out.

    Args:
        parts: pairs of a weight above 0 and a model.
    """

    def __init__(self, parts: Iterable[tuple[float, Likelihood]]) -> None:
        pairs = list(parts)
        if not pairs or not all(_is_weighted(pair) for pair in pairs):
            raise MisuseError(
                "Weighted needs pairs of a weight above 0 and a model, "
                "such as [(2.0, Prior(0.8)), ...]"
            )
        self.parts = [(weight, as_model(model)) for weight, model in pairs]
        self.is_constant = all(model.is_constant for _, model in self.parts)
        self.variables = [variable for _, model in self.parts for variable in model.variables]

    def value(self, situation: Situation, leaf: str, symbol: str, /) -> float | None:
        """Return the mean of the known likelihoods.

        Args:
            situation: the present situation.
            leaf: the label of the state.
            symbol: the symbol of the transition.
        """
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
    """Return a model as it is; wrap a function into a model that calls it."""
    check("a transition", _LIKELIHOOD, likelihood=likelihood)
    return likelihood if isinstance(likelihood, LikelihoodModel) else Computed(likelihood)


def checked_likelihood(likelihood: Any, subject: str) -> float:
    """Return the likelihood as a number in [0, 1], without rounding errors. Raises
    UnsoundMachine.
    """
    if not isinstance(likelihood, int | float) or not -_ROUNDING <= likelihood <= 1 + _ROUNDING:
        raise UnsoundMachine(f"{subject} must be a number in [0, 1], not {likelihood!r:.60}")
    return min(max(float(likelihood), 0.0), 1.0)
