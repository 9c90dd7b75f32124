"""The preview list: the most probable path from a state to the next steady one.

The search extends the most probable path first (Dijkstra), so the first path that reaches a steady
state is the most probable of all. If each state has one likely arrow, the search visits hardly any
state beside the path.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from math import frexp, fsum, ldexp, nextafter

from tca_behaviours.coordination.model.automaton import Automaton
from tca_module import checks
from tca_module.checks import check
from tca_wire.coordination import Foreseen

_ABOVE_0 = checks.number("above 0, and 1 at most", nextafter(0, 1), 1)
_BELOW_1 = checks.number("0 or more, and less than 1", 0, nextafter(1, 0))


@dataclass(frozen=True)
class PreviewLimits:
    """The limits of a preview.

    A *steady* state ends a preview: the machine probably stays in it. A state is steady if 1 minus
    the sum of its likelihoods is *final* or more, or if none of its likelihoods exceeds
    *transition*.

    Args:
        final: the least probability of staying in a steady state. Default: 0.5.
        transition: the greatest likelihood of an arrow out of a steady state. Default: 0.
        horizon: the most states of a preview; None: without limit.
    """

    final: float = 0.5
    transition: float = 0.0
    horizon: int | None = None

    def __post_init__(self) -> None:
        check("PreviewLimits", _ABOVE_0, final=self.final)
        check("PreviewLimits", _BELOW_1, transition=self.transition)
        check("PreviewLimits", checks.MAXIMUM, horizon=self.horizon)

    def is_steady(self, automaton: Automaton, state: int) -> bool:
        """Return whether a preview ends in a state.

        Args:
            automaton: the machine in its present situation.
            state: the leaf's number.
        """
        likelihoods = [arrow.likelihood for arrow in automaton.arcs(state)]
        return 1 - fsum(likelihoods) >= self.final or max(likelihoods) <= self.transition


_NO_LIMITS = PreviewLimits()


class _Path:
    """A path to a state: its last arrow, and the path *before* that arrow.

    The probability of a path of thousands of states is below the least float, so it is stored as a
    mantissa and an exponent.
    """

    __slots__ = ("before", "exponent", "length", "likelihood", "mantissa", "place", "state")

    def __init__(
        self, state: int, before: "_Path | None" = None, place: int = 0, likelihood: float = 1.0
    ) -> None:
        self.state = state
        self.before = before
        self.place = place  # the place of the last arrow among the arrows of its source
        self.likelihood = likelihood
        self.length: int = before.length + 1 if before else 0
        mantissa, exponent = frexp(likelihood * before.mantissa if before else 1.0)
        self.mantissa: float = mantissa
        self.exponent: int = exponent + before.exponent if before else exponent

    @property
    def probability(self) -> float:
        """The probability; 0 if it is below the least float."""
        return ldexp(self.mantissa, self.exponent)

    def __lt__(self, other: "_Path") -> bool:
        """Return whether this path comes first. The more probable path does, or else the shorter
        one, or else the one whose arrows are written first.
        """
        if self.exponent != other.exponent:
            return self.exponent > other.exponent
        if self.mantissa != other.mantissa:
            return self.mantissa > other.mantissa
        if self.length != other.length:
            return self.length < other.length
        mine, others = self, other
        while mine.before is not others.before and mine.before and others.before:
            mine, others = mine.before, others.before
        return mine.place < others.place

    def foreseen(self) -> list[Foreseen]:
        """Return the states after the first one."""
        found = []
        path = self
        while path.before is not None:
            found.append(Foreseen(path.state, path.likelihood, path.probability))
            path = path.before
        return found[::-1]


def most_likely(
    automaton: Automaton, state: int, limits: PreviewLimits = _NO_LIMITS
) -> list[Foreseen]:
    """Return the most probable path from a state to a steady state. The steady state is included.

    The path is empty if the current state is steady. It ends after ``limits.horizon`` states at the
    latest. Among equally probable paths, the shortest comes first, then the one whose arrows are
    written first. If no steady state can be reached, the path follows the likeliest arrow of each
    state until a state repeats.

    Args:
        automaton: the machine in its present situation.
        state: the current leaf.
        limits: the limits of the preview.

    Returns:
        The foreseen states, the next one first.
    """
    queue = [_Path(state)]
    visited: set[tuple[int, int]] = set()
    while queue:
        path = heappop(queue)
        # With a horizon the length of a path matters, too: the longer path ends sooner.
        node = (path.state, path.length if limits.horizon else 0)
        if node in visited:
            continue
        visited.add(node)
        if path.length == limits.horizon or limits.is_steady(automaton, path.state):
            return path.foreseen()
        for place, arrow in enumerate(automaton.arcs(path.state)):
            if arrow.likelihood > 0:
                heappush(queue, _Path(arrow.target, path, place, arrow.likelihood))
    return list(_likeliest_path(automaton, state))


def _likeliest_path(automaton: Automaton, state: int) -> Iterator[Foreseen]:
    """Follow the likeliest arrow of each state until a state repeats."""
    probability = 1.0
    entered = {state}
    while True:
        arrow = max(automaton.arcs(state), key=lambda arrow: arrow.likelihood)
        state = arrow.target
        if state in entered:
            return
        entered.add(state)
        probability *= arrow.likelihood
        yield Foreseen(state, arrow.likelihood, probability)
