"""What a chart consists of: rows of bars, and what is told of each."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

from tca_tools.terminal import cut
from tca_wire.text.printable import printable

_FEWEST = 8
"""Columns of a reason."""


@dataclass(slots=True)
class Part:
    """A part of a bar: its handler waits."""

    start: float
    end: float
    tell: Callable[[], str]

    @property
    def title(self) -> str:
        """All there is to say about it."""
        return self.tell()


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment of a bar."""

    time: float
    has_coped: bool
    """Whether the run went on after that failure."""
    title: str
    """All there is to say about it."""


@dataclass(slots=True)
class Bar:
    """A message in a resource: handled, waited for outside of a handler, queued, suspended or held."""

    name: str
    tell: Callable[[], str]
    start: float
    end: float
    is_open: bool
    """Whether it went on when the journal ended."""
    has_failed: bool = False
    has_coped: bool = False
    """Whether the run went on after that failure."""
    was_killed: bool = False
    """Whether its handler was at work when it was killed."""
    waits: list[Part] = field(default_factory=list)
    raised: list[Mark] = field(default_factory=list)
    """The failures that were raised on it meanwhile, beside its handler."""
    is_suspended: bool = False
    why: Callable[[], str] | None = None
    """Of what is held: what that waits for, with its name; it stands on the bar if there is room for some of it."""
    first: "Bar | None" = None
    """Of what is held by one thing after the other the bar of the first, in whose lane it is ..."""
    lasts_until: float = -inf
    """... and of that, when the last of them ends."""
    is_beside: bool = False
    """Whether it is not what was asked for, but what that waited for."""
    is_outside: bool = False
    """Whether a module waits for it outside of any handler."""
    lane: int = 0
    """Bars of one lane do not overlap."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What may stand on it, the best first: ``waits for walk``, ``walk``."""
        return (f"waits for {self.name}", self.name) if self.is_outside else (self.name,)

    @property
    def is_waiting(self) -> bool:
        """Whether its handler mostly waited: so it looks where there is no room for more."""
        return 2 * sum(wait.end - wait.start for wait in self.waits) > self.end - self.start

    @property
    def title(self) -> str:
        """All there is to say about it."""
        return self.tell()

    def words(self, columns: int) -> str:
        """Why it is held, in so many columns; "" if that are too few to say anything."""
        return cut(printable(self.why()), columns) if self.why and columns >= _FEWEST else ""


@dataclass(slots=True)
class Held:
    """Somebody has a resource for himself."""

    start: float
    end: float
    is_reserved: bool
    owner: str
    is_open: bool
    """Whether he had it when the journal ended."""
    tell: Callable[[], str]

    @property
    def title(self) -> str:
        """All there is to say about it."""
        return self.tell()


@dataclass(slots=True)
class Row:
    """One resource."""

    label: str
    connected: list[tuple[float, float]] = field(default_factory=list)
    handled: list[Bar] = field(default_factory=list)
    queued: list[Bar] = field(default_factory=list)
    """What waits for the resource."""
    held_back: list[Bar] = field(default_factory=list)
    """What constraints hold back that would be handled there."""
    held: list[Held] = field(default_factory=list)
    """Its locks and reservations."""
    is_offered: bool = False
    """Whether its module offers to handle something."""
    is_nobodys: bool = False
    """Whether it is of what is no module's."""

    @property
    def lanes(self) -> int:
        """How many lanes the handled bars need."""
        return max((bar.lane + 1 for bar in self.handled), default=1 if self.connected or self.held else 0)

    @property
    def queue_lanes(self) -> int:
        """How many lanes the queued bars need."""
        return max((bar.lane + 1 for bar in self.queued), default=0)

    @property
    def queue_kind(self) -> str:
        """What those do that wait for it."""
        suspended = {bar.is_suspended for bar in self.queued}
        return "suspended" if suspended == {True} else "queued" if suspended == {False} else "queued or suspended"

    @property
    def held_lanes(self) -> int:
        """How many lanes the bars need of what is held back."""
        return max((bar.lane + 1 for bar in self.held_back), default=0)

    @property
    def bars(self) -> list[Bar]:
        """All its bars."""
        return [*self.handled, *self.queued, *self.held_back]


@dataclass(slots=True)
class Chart:
    """Rows over a span of time."""

    start: float
    end: float
    rows: list[Row]
    names: list[str]
    """Messages in the order in which they were first sent, whatever the span: a name's place tells its colour."""
