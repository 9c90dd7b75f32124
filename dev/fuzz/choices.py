"""Bytes as a sequence of choices, which a fuzzer or a random generator makes."""

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """Choices made by bytes. Each choice consumes some. When no bytes are left, the first option is
    chosen.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def is_over(self) -> bool:
        """Whether no bytes are left."""
        return self._at >= len(self._data)

    def take(self, size: int) -> bytes:
        """Consume and return the next bytes, as far as there are any."""
        taken = self._data[self._at : self._at + size]
        self._at += size
        return taken

    def below(self, number: int) -> int:
        """Return a number from 0 to *number* - 1."""
        return int.from_bytes(self.take(1 if number <= 256 else 2)) % number

    def one_of(self, options: Sequence[T]) -> T:
        """Return one of the options."""
        return options[self.below(len(options))]

    def once_in(self, number: int) -> bool:
        """Make a choice that is True once in *number* times."""
        return self.below(number) == number - 1
