"""Errors in functions that only a preview calls."""

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


class Mistakes:
    """Errors in likelihoods, costs and policies, and in what reads the progress of early work. In a
    run each is told once, and the run goes on without that bit of preview; elsewhere it is raised.
    What else stops a preview is told once, too.
    """

    def __init__(self, tell: Callable[[str], object] | None = None) -> None:
        self._tell = tell
        self._told = set[str]()

    def otherwise(self, value: T, what: str, function: Callable[[], T]) -> T:
        """The result of a function; that *value* if it fails, for the reason that *what* follows
        from it.
        """
        try:
            return function()
        except Exception as error:
            if self._tell is None:
                raise
            self.tell(what, f"{type(error).__name__}: {error}")
            return value

    def tell(self, what: str, why: str) -> None:
        """Tell once what follows, and why or what to do."""
        if what not in self._told and self._tell is not None:
            self._told.add(what)
            self._tell(f"{what}: {why}")
