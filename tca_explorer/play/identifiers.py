"""Numbers that are names. Central copies and counts them like any number, and they can still be told from counts."""

from typing import Self


class Identifier(int):
    """A number that only names something: what matters is which are equal, not what they are."""

    __slots__ = ()

    def __add__(self, other: int) -> Self:
        return type(self)(int(self) + other)


class MessageId(Identifier):
    """Names a message or delivery in central."""

    __slots__ = ()


class RequestNumber(Identifier):
    """Names a request of a connection."""

    __slots__ = ()
