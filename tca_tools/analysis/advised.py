"""What advice is made of: a topic, words and bounds."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from tca_tools.spans import Cover, Span


class Topic(StrEnum):
    """What a piece of advice is about."""

    FAILURE = "failures"
    OVERLAP = "plan while acting"
    QUERY = "ask sooner"
    IN_VAIN = "asked in vain"
    CAPACITY = "more capacity"
    LOCK = "shorter locks"
    HANDLER = "missing handler"
    SUSPENDED = "suspended"
    DELAY = "delays"


@dataclass(slots=True)
class Advice:
    """Something that would make the run shorter."""

    topic: Topic
    title: str
    text: str
    saving: float
    """At most so many seconds."""
    on_path: float
    """How many of them lie on the critical path that the report shows first: only these make the end come sooner."""
    times: int
    """How often it happened."""
    example: str = ""
    """The case with the greatest bound."""
    remedy: str = ""
    window: tuple[float, float] | None = None
    """When the example happened."""
    sooner: str = ""
    """The task whose end would come sooner, if it is another than that which ended last."""


class Words(NamedTuple):
    """What a topic has to say: a title, what was found, and what to do."""

    title: str
    text: str
    remedy: str


@dataclass(slots=True)
class Sum:
    """What went on for one reason, at several times."""

    spans: list[Span] = field(default_factory=list)
    words: str = ""
    """Of the longest."""

    def add(self, start: float, end: float, words: str) -> None:
        """Once more, with words for that."""
        if not self.spans or end - start > length(self.longest):
            self.words = words
        self.spans.append((start, end))

    @property
    def times(self) -> int:
        """How often."""
        return len(self.spans)

    @property
    def longest(self) -> Span:
        """The longest of them."""
        return max(self.spans, key=length)

    def within(self, start: float, end: float) -> float:
        """Seconds of a window; where they overlap, once."""
        return Cover(self.spans).within(start, end)


def length(span: Span) -> float:
    """How long one is, in seconds."""
    return span[1] - span[0]
