"""Errors in functions that only a preview calls."""

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


class Mistakes:
    """Handles errors in likelihoods, costs, policies, and in functions that read the progress of
    early work.

    In a run, each consequence is reported once, and the run continues without that part of its
    preview. Without a function *report* the error is raised.
    """

    def __init__(self, report: Callable[[str], object] | None = None) -> None:
        self._report = report
        self._reported = set[str]()

    def value_or(self, value: T, consequence: str, function: Callable[[], T]) -> T:
        """Return the result of a function. If the function raises, report the error and return
        *value*.

        *consequence* describes the effect of the error, for the report.
        """
        try:
            return function()
        except Exception as error:
            if self._report is None:
                raise
            self.report(consequence, f"{type(error).__name__}: {error}")
            return value

    def report(self, consequence: str, why: str) -> None:
        """Report a consequence once, with its reason or its remedy."""
        if consequence not in self._reported and self._report is not None:
            self._reported.add(consequence)
            self._report(f"{consequence}: {why}")
