"""Bytes read as a row of choices: whoever makes the bytes, a fuzzer or a random generator, makes
the choices.
"""

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """Every choice takes a byte or two; when there are none left it is always the first one."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def is_over(self) -> bool:
        """Whether no bytes are left."""
        return self._at >= len(self._data)

    def take(self, size: int) -> bytes:
        """The next bytes, as far as there are so many."""
        taken = self._data[self._at : self._at + size]
        self._at += size
        return taken

    def below(self, number: int) -> int:
        """A number from 0 to *number* - 1."""
        return int.from_bytes(self.take(1 if number <= 256 else 2)) % number

    def one_of(self, these: Sequence[T]) -> T:
        """One of these."""
        return these[self.below(len(these))]

    def is_one_in(self, number: int) -> bool:
        """True once in so many times."""
        return self.below(number) == number - 1
