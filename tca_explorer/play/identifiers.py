"""Numbers that are names. Central copies and counts them like any number, and they can still be told from counts.

They differ from run to run, so central's texts must not have them: a script that read one would be another in each run.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Self

_are_shown = ContextVar("_are_shown", default=False)


@contextmanager
def numbers_shown() -> Iterator[None]:
    """Texts that are made meanwhile have these numbers: they are for people."""
    token = _are_shown.set(True)
    try:
        yield
    finally:
        _are_shown.reset(token)


class Identifier(int):
    """A number that only names something: what matters is which are equal, not what they are."""

    __slots__ = ()

    def __add__(self, other: int) -> Self:
        return type(self)(int(self) + other)

    def __str__(self) -> str:
        return repr(self) if _are_shown.get() else "…"


class MessageId(Identifier):
    """Names a message or delivery in central."""

    __slots__ = ()


class RequestNumber(Identifier):
    """Names a request of a connection."""

    __slots__ = ()
