"""Properties of whole runs: the share of good cases, checked at the end of the run."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from tca_tools.properties.algebra import Property, words_of
from tca_tools.properties.world import BadProperty

CasesOf = Callable[[Any], Iterable[tuple[Any, bool]]]
"""A function of a run's records that yields its cases: a message, and whether the case is good."""


class Counted(NamedTuple):
    """The counted cases of a run."""

    number: int
    """The number of cases."""
    bad: list[Any]
    """The messages of the bad cases."""

    @property
    def good(self) -> int:
        """The number of good cases."""
        return self.number - len(self.bad)

    @property
    def share(self) -> float:
        """The share of good cases; 1 if there is no case."""
        return self.good / self.number if self.number else 1.0

    def __str__(self) -> str:
        return f"{self.good:,} of {self.number:,}"


class CasesProperty(Property):
    """The property that at least a share of a run's cases is good; see ``in_at_least``."""

    def __init__(self, words: str, cases: CasesOf, least: float, fewest: int = 1) -> None:
        super().__init__(words)
        self.fewest = fewest
        self._cases = cases
        self._least = least

    def count(self, run: Any) -> Counted:
        """Count the cases of a run."""
        number, bad = 0, []
        for case in self._cases(run):
            message, is_good = _checked_case(case)
            number += 1
            if not is_good:
                bad.append(message)
        return Counted(number, bad)

    def allows(self, counted: Counted) -> bool:
        """Whether the property is true of a run with such counts, or does not judge it."""
        return counted.share >= self._least or counted.number < self.fewest

    def why_not_judged(self, counted: Counted) -> str:
        """Return why the property does not judge a run; "" if it does."""
        if counted.number >= self.fewest:
            return ""
        if not counted.number:
            return "in this run there was no case of it"
        return f"in this run there were {counted.number} cases of it, and it needs {self.fewest}"


def in_all_cases(cases: CasesOf) -> CasesProperty:
    """Return the property that all cases of a run are good.

    Args:
        cases: a function of the run's records that yields (message, is_good) for each case.

    Raises:
        BadProperty: *cases* is not a function.

    Example::

        def grasp_has_a_photograph(run: Run) -> Iterator[tuple[Task, bool]]:
            for task in run.tasks.values():
                if task.name == "grasp":
                    names = [run.tasks[child].name for child in task.children]
                    yield task, "photograph" in names

        CARE = in_all_cases(grasp_has_a_photograph)
    """
    return CasesProperty(f"{words_of(_checked_function(cases))}, in all cases", cases, 1.0)


def in_at_least(share: float, cases: CasesOf, *, fewest: int = 1) -> CasesProperty:
    """Return the property that at least a share of a run's cases is good.

    Args:
        share: the share, from 0 to 1; 0.9 is nine of ten.
        cases: a function of the run's records that yields (message, is_good) for each case.
        fewest: the least number of cases; a run with fewer is not judged. Five cases, for example,
            do not distinguish 0.9 from 1.

    Raises:
        BadProperty: an argument is invalid.
    """
    if not isinstance(share, int | float) or isinstance(share, bool) or not 0 <= share <= 1:
        raise BadProperty(
            f"in_at_least() needs a share from 0 to 1, such as 0.9, not {share!r:.60}"
        )
    if not isinstance(fewest, int) or isinstance(fewest, bool) or fewest < 1:
        raise BadProperty(f"fewest must be a whole number from 1, not {fewest!r:.60}")
    words = f"{words_of(_checked_function(cases))}, in at least {share * 100:g} % of cases"
    return CasesProperty(words, cases, share, fewest)


def _checked_function(cases: Any) -> CasesOf:
    if not callable(cases):
        raise BadProperty(
            f"cases must be a function of the run that yields (message, is_good), not {cases!r:.60}"
        )
    return cases  # type: ignore[no-any-return]


def _checked_case(case: Any) -> tuple[Any, bool]:
    if not (
        isinstance(case, tuple)
        and len(case) == 2
        and hasattr(case[0], "id")
        and isinstance(case[1], bool)
    ):
        raise TypeError(f"it yielded {case!r:.60}: a case is a message, and True or False")
    return case
