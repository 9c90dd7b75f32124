"""Whether it is worth while to start an activity before its turn, and how fast: utilities, and
policies.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import floor
from sys import float_info

from tca_module import MisuseError
from tca_module.checks import FUNCTION, check, number


@dataclass(frozen=True)
class Candidate:
    """An activity that may run ahead, as a policy sees it."""

    state: int
    index: int
    """Its place in the preview list: 1 for the state that follows the current one."""
    likelihood: float
    """Of the arrow that leads to its state."""
    probability: float
    """Of the whole path that leads there."""
    progress_before: float
    """Of the activity before it, in [0, 1]: 0 before that begins and in a wait for an event, 1 once
    it runs if its tasks can report no progress.
    """
    cost: float
    """Of doing it in vain."""
    undo_cost: float = 0.0
    """Of undoing it: as much as its cost if a branch may need that, otherwise 0."""
    progress: float = 0.0
    """Its own."""
    share: float = 0.0
    """Of full speed, with which it runs ahead now; 0: it does not run."""
    progress_of_current: float = 0.0
    """Of the activity of the current state, in [0, 1]; 1 where its tasks can report none."""
    state_before: int = -1
    """The state whose activity comes before it."""


Utility = Callable[[Candidate], float]
"""What an activity ahead is worth."""


def expected_gain(candidate: Candidate) -> float:
    """With the probability p of its path, the progress b of the activity before, its own progress
    x, its cost C and that of undoing it D: ``p * b - (1 - p) * (1 - x) * (C + D)``.
    """
    gain = candidate.probability * candidate.progress_before
    loss = (
        (1 - candidate.probability)
        * (1 - candidate.progress)
        * (candidate.cost + candidate.undo_cost)
    )
    return gain - loss


def progress_only(candidate: Candidate) -> float:
    """The progress of the activity before, and nothing else."""
    return candidate.progress_before


_NUMBER = number("a number", -float_info.max, float_info.max)
_SHARE = number("a number in [0, 1]", 0, 1)


class Policy:
    """How the utility of an activity becomes a share of full speed. Base class: give ``wanted``."""

    def __init__(self, utility: Utility = expected_gain) -> None:
        check(type(self).__name__, FUNCTION, utility=utility)
        self.utility = utility

    def wanted(self, utility: float) -> float:
        """The share in [0, 1] for this utility, which grows with it; 0: the activity does not run
        ahead.
        """
        raise NotImplementedError

    def share(self, candidate: Candidate) -> float:
        """The share of full speed for an activity.

        Progress of the activity before says when to begin. It is not asked again: an activity that
        runs goes on as it does until its path has become too unlikely.
        """
        share = self.wanted(self.utility(candidate))
        if not candidate.share:
            return share
        at_its_turn = self.wanted(self.utility(replace(candidate, progress_before=1.0)))
        return max(share, min(candidate.share, at_its_turn))


class Discrete(Policy):
    """At full speed if the utility is *threshold* or more, otherwise not at all."""

    def __init__(self, threshold: float = 0.5, utility: Utility = expected_gain) -> None:
        super().__init__(utility)
        check("Discrete", _NUMBER, threshold=threshold)
        self.threshold = threshold

    def wanted(self, utility: float) -> float:
        """1 or 0."""
        return 1.0 if utility >= self.threshold else 0.0


class Continuous(Policy):
    """The share grows evenly from 0 at the utility *from_* to 1 at *to*, in steps of a tenth, so
    that a task does not get a new speed at each report. An activity without ``adapt`` runs at full
    speed or not at all.
    """

    def __init__(
        self, from_: float = 0.2, to: float = 0.8, utility: Utility = expected_gain
    ) -> None:
        super().__init__(utility)
        check("Continuous", _NUMBER, from_=from_, to=to)
        self.from_, self.to = from_, to
        if from_ >= to:
            raise MisuseError(f"from_ must be less than to, not {from_!r} with to={to!r}")

    def wanted(self, utility: float) -> float:
        """The share, in tenths."""
        if utility >= self.to:
            return 1.0
        return floor(10 * max(utility - self.from_, 0.0) / (self.to - self.from_)) / 10


def checked_share(share: float) -> float:
    """What a policy has said. Raises MisuseError if that is no share."""
    check("a policy", _SHARE, share=share)
    return share
