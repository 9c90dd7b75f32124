"""Properties of whole runs: of how many of its cases something is so. They are asked once, when the
run is over.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from tca_tools.properties.algebra import Property, words_of
from tca_tools.properties.world import BadProperty

CasesOf = Callable[[Any], Iterable[tuple[Any, bool]]]
"""A function of the records of a run: for each case the message that it is about, and whether all
is well with it.
"""


class Counted(NamedTuple):
    """The cases of a run."""

    number: int
    bad: list[Any]
    """The messages of those with which all is not well."""

    @property
    def good(self) -> int:
        """How many are as they should be."""
        return self.number - len(self.bad)

    @property
    def share(self) -> float:
        """How many of all that is; 1 if there are none."""
        return self.good / self.number if self.number else 1.0

    def __str__(self) -> str:
        return f"{self.good:,} of {self.number:,}"


class CasesProperty(Property):
    """Of a run, at least a share of the cases is as it should be. It says nothing of a run with
    fewer cases than *fewest*.
    """

    def __init__(self, words: str, cases: CasesOf, least: float, fewest: int = 1) -> None:
        super().__init__(words)
        self.fewest = fewest
        self._cases = cases
        self._least = least

    def count(self, run: Any) -> Counted:
        """The cases of a run."""
        number, bad = 0, []
        for case in self._cases(run):
            message, is_good = _checked_case(case)
            number += 1
            if not is_good:
                bad.append(message)
        return Counted(number, bad)

    def allows(self, counted: Counted) -> bool:
        """Whether it is true of a run with these cases, or says nothing of it."""
        return counted.share >= self._least or counted.number < self.fewest

    def why_not_judged(self, counted: Counted) -> str:
        """Why it says nothing of a run with these cases; "" if it says something."""
        if counted.number >= self.fewest:
            return ""
        few = f"there were {counted.number} cases of it: it judges {self.fewest} or more"
        return f"in this run {few if counted.number else 'there was no case of it'}"


def in_all_cases(cases: CasesOf) -> CasesProperty:
    """Each of the *cases* of a run is as it should be."""
    return CasesProperty(f"{words_of(_checked_function(cases))}, in all cases", cases, 1.0)


def in_at_least(share: float, cases: CasesOf, *, fewest: int = 1) -> CasesProperty:
    """Of the *cases* of a run at least this share (0.9: nine of ten) is as it should be. A run with
    fewer cases than *fewest* is not judged: of five cases 0.9 can't be told from 1.
    """
    if not isinstance(share, int | float) or isinstance(share, bool) or not 0 <= share <= 1:
        raise BadProperty(
            f"in_at_least() takes a share from 0 to 1, such as 0.9, and {share!r:.60} is none"
        )
    if not isinstance(fewest, int) or isinstance(fewest, bool) or fewest < 1:
        raise BadProperty(f"fewest={fewest!r:.60} is no number of cases: give 1 or more")
    words = f"{words_of(_checked_function(cases))}, in at least {share * 100:g} % of cases"
    return CasesProperty(words, cases, share, fewest)


def _checked_function(cases: Any) -> CasesOf:
    if not callable(cases):
        raise BadProperty(
            f"{cases!r:.60} gives no cases: give a function of the run that yields (message, is_good)"
        )
    return cases  # type: ignore[no-any-return]


def _checked_case(case: Any) -> tuple[Any, bool]:
    if not (
        isinstance(case, tuple)
        and len(case) == 2
        and hasattr(case[0], "id")
        and isinstance(case[1], bool)
    ):
        raise TypeError(f"it gave {case!r:.60}: a case is a message, and True or False")
    return case
