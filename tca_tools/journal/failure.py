"""A failure as the tools show it."""

from typing import Self


class Failure(str):
    """A failure as text: its *name* and its description, *words*; empty if there is no failure."""

    __slots__ = ("name", "words")
    name: str
    words: str

    def __new__(cls, name: str = "", words: str = "") -> Self:
        """Make the text ``name: words``."""
        self = super().__new__(cls, f"{name}: {words}" if words else name)
        self.name, self.words = name, words
        return self


NO_FAILURE = Failure()
