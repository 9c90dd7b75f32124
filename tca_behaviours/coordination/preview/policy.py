"""Utilities and policies: whether an activity should start early, and how fast it should run."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import floor
from sys import float_info

from tca_module import MisuseError
from tca_module.checks import FUNCTION, check, number


@dataclass(frozen=True)
class Candidate:
    """An activity that may run early, as a policy sees it."""

    state: int
    index: int
    """Its place in the preview list: 1 for the state that follows the current one."""
    likelihood: float
    """The likelihood of the arrow that leads to its state."""
    probability: float
    """The probability of the whole path to its state."""
    progress_before: float
    """The progress of the activity before this one, in [0, 1].

    It is 0 until the activity before begins, and 0 if that state only waits for an event. If the
    activity before can't report progress, it is 1 as soon as that activity runs.
    """
    cost: float
    """The cost of this activity if it runs in vain."""
    undo_cost: float = 0.0
    """The cost of undoing this activity. Equal to ``cost`` if the activity changes a fact that a
    branch may need; otherwise 0.
    """
    progress: float = 0.0
    """The progress of this activity, in [0, 1]."""
    share: float = 0.0
    """The share of full speed at which this activity runs early now; 0: it does not run."""
    progress_of_current: float = 0.0
    """The progress of the current activity, in [0, 1]; 1 if its tasks can report none."""
    state_before: int = -1
    """The state whose activity comes before this one."""


Utility = Callable[[Candidate], float]
"""The value of running an activity early."""


def expected_gain(candidate: Candidate) -> float:
    """Return the expected gain of an activity that runs early: ``p * b - (1 - p) * (1 - x) * (C +
    D)``.

    p is the probability of the activity's path, x its progress, and C its cost. b is the progress
    of the activity before. D is the cost of undoing the activity.

    Args:
        candidate: an activity that might run early.
    """
    gain = candidate.probability * candidate.progress_before
    loss = (
        (1 - candidate.probability)
        * (1 - candidate.progress)
        * (candidate.cost + candidate.undo_cost)
    )
    return gain - loss


def progress_only(candidate: Candidate) -> float:
    """Return the progress of the activity before, and nothing else.

    Args:
        candidate: an activity that might run early.
    """
    return candidate.progress_before


_NUMBER = number("a number", -float_info.max, float_info.max)
_SHARE = number("a number in [0, 1]", 0, 1)


class Policy:
    """Converts the utility of an activity to a share of full speed. A subclass defines ``wanted``.

    Args:
        utility: a function of the Candidate. Default: ``expected_gain``.
    """

    def __init__(self, utility: Utility = expected_gain) -> None:
        check(type(self).__name__, FUNCTION, utility=utility)
        self.utility = utility

    def wanted(self, utility: float) -> float:
        """Return the share of full speed for a utility.

        The share must not fall as the utility grows.

        Args:
            utility: the utility of an activity.

        Returns:
            The share, in [0, 1]; 0: do not run early.
        """
        raise NotImplementedError

    def share(self, candidate: Candidate) -> float:
        """Return the share of full speed for an activity.

        The progress of the activity before decides only when this one starts. A running activity
        keeps its speed until its path has become too unlikely.

        Args:
            candidate: an activity that might run early.

        Returns:
            The share, in [0, 1].
        """
        share = self.wanted(self.utility(candidate))
        if not candidate.share:
            return share
        share_by_path = self.wanted(self.utility(replace(candidate, progress_before=1.0)))
        return max(share, min(candidate.share, share_by_path))


class Discrete(Policy):
    """Full speed if the utility is *threshold* or more, otherwise not at all.

    Args:
        threshold: the least utility. Default: 0.5.
        utility: a function of the Candidate. Default: ``expected_gain``.
    """

    def __init__(self, threshold: float = 0.5, utility: Utility = expected_gain) -> None:
        super().__init__(utility)
        check("Discrete", _NUMBER, threshold=threshold)
        self.threshold = threshold

    def wanted(self, utility: float) -> float:
        """Return full speed or nothing.

        Args:
            utility: the utility of an activity.

        Returns:
            1 if the utility is the threshold or more, otherwise 0.
        """
        return 1.0 if utility >= self.threshold else 0.0


class Continuous(Policy):
    """A share that grows linearly with the utility, from 0 at *from_* to 1 at *to*.

    It changes in steps of a tenth, so that a task does not get a new speed at each report. An
    activity without ``adapt`` runs at full speed or not at all.

    Args:
        from_: the utility of share 0. Default: 0.2.
        to: the utility of share 1. Default: 0.8.
        utility: a function of the Candidate. Default: ``expected_gain``.
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
        """Return the share of full speed for a utility.

        Args:
            utility: the utility of an activity.

        Returns:
            The share, in tenths.
        """
        if utility >= self.to:
            return 1.0
        return floor(10 * max(utility - self.from_, 0.0) / (self.to - self.from_)) / 10


def checked_share(share: float) -> float:
    """Return the share that a policy returned. Raises MisuseError unless it is a number in [0,
    1].
    """
    check("a policy", _SHARE, share=share)
    return share
