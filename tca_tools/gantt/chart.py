"""The parts of a chart: rows of bars, and all there is to say about each."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import chain
from math import inf
from operator import attrgetter

from tca_tools.spans import Span, lanes
from tca_tools.terminal import cut
from tca_wire.coordination import TaskRole
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Outcome

_FEWEST = 8
"""Columns of a reason."""


class BarKind(StrEnum):
    """The kinds of bars."""

    HANDLED = "handling"
    AWAITED = "awaited"  # a module waits for it outside of any handler
    IDLE = "idle"  # an agent has nothing to do
    WAITING = "waiting"  # a part of a bar: its handler waits
    QUEUED = "queued"
    SUSPENDED = "suspended"
    HELD = "held"
    LOCKED = "locked"
    RESERVED = "reserved"


class Ending(StrEnum):
    """How a handler ended, if it was no success; or what became of a failure."""

    NONE = ""
    FAILED = "failed"
    COPED = "coped"  # it failed, and the run went on
    RESOLVED = "resolved"  # it failed, and its task is done after that
    KILLED = "killed"  # its handler was at work when it was killed


CONNECTED, CURVE = "connected", "curve"
MARKED = {Ending.FAILED: "mark-failed", Ending.COPED: "mark-coped", Ending.NONE: "mark-request"}
"""The names of marks."""
FLAGGED = (Ending.FAILED, Ending.COPED, Ending.RESOLVED)
"""What has a flag, the worst first."""
MEANINGS: dict[str, str] = {
    BarKind.HANDLED: "handling",
    BarKind.WAITING: "waiting for a reply, task or lock",
    BarKind.QUEUED: "queued",
    BarKind.SUSPENDED: "suspended",
    BarKind.HELD: "held",
    BarKind.LOCKED: "locked",
    BarKind.RESERVED: "reserved",
    CONNECTED: "connected",
    TaskRole.AHEAD: "ahead of its state",
    TaskRole.WASTED: "ahead, and wasted",
    Ending.FAILED: "failed",
    Ending.COPED: "failed, and handled",
    Ending.RESOLVED: str(Outcome.RESOLVED),
    Ending.KILLED: "killed",
    "mark-failed": "failure raised beside the handler",
    "mark-coped": "failure raised beside the handler, and handled",
    "mark-request": "request of a client, or its answer",
    CURVE: "how many are queued or suspended",
    "flag-failed": "here something failed",
    "flag-coped": "here something failed, and was handled",
    "flag-resolved": f"here something failed, and is {Outcome.RESOLVED}",
}
"""The legend of a chart: what is to be seen in it, by the name of its look (see ``chart.css``), and
what that means.
"""


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment in a bar: a failure that was raised beside the handler, or a request of a client, or
    its answer.
    """

    time: float
    ending: Ending
    title: str


@dataclass(slots=True)
class Bar:
    """A span of time in a row; of a lock or reservation the name is its owner's."""

    name: str
    start: float
    end: float
    title: Callable[[], str] = str
    """Tells all there is to say about it."""
    kind: BarKind = BarKind.HANDLED
    is_open: bool = False
    """Whether it went on when the journal ended."""
    is_beside: bool = False
    """Whether it is not what was asked for, but what that waited for."""
    ending: Ending = Ending.NONE
    waits: "Sequence[Bar]" = ()
    marks: Sequence[Mark] = ()
    why: Callable[[], str] | None = None
    """Of what is held: what that waits for. It stands on the bar if some of it has room."""
    follows: "Bar | None" = None
    """Of what is held by one thing after the other: the first bar, in whose lane it is."""
    lane: int = 0
    """Bars of one lane do not overlap."""
    ahead_until: float = -inf
    """Of a task of a coordinator: until when it ran ahead of its state."""
    is_wasted: bool = False
    """Whether that was for nothing."""
    brief: str = ""
    """A label where the name has no room."""
    parts: "Sequence[Bar]" = ()
    """The bars for which it stands, if they are too narrow to be drawn one by one."""

    @property
    def ahead(self) -> tuple[float, float] | None:
        """The part that ran ahead of its state."""
        if self.ahead_until <= self.start:
            return None
        return self.start, min(self.end, self.ahead_until)

    @property
    def preview(self) -> TaskRole:
        """How that part looks."""
        return TaskRole.WASTED if self.is_wasted else TaskRole.AHEAD

    @property
    def seconds(self) -> float:
        """How long it is; of several bars, how long those are together."""
        if self.parts:
            return sum(part.seconds for part in self.parts)
        return self.end - self.start

    @property
    def until(self) -> float | None:
        """When it ended; None if it went on when the journal ended."""
        return None if self.is_open else self.end

    @property
    def is_waiting(self) -> bool:
        """Whether its handler mostly waited: it looks so where there is no room for more."""
        return 2 * sum(wait.seconds for wait in self.waits) > self.seconds

    def words(self, columns: int) -> str:
        """Why it is held, in so many columns; "" if that are too few to say anything."""
        if self.why is None or columns < _FEWEST:
            return ""
        return cut(printable(self.why()), columns)

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels that may stand on it, the best first: ``waits for walk``, ``walk``."""
        if self.kind is BarKind.AWAITED:
            return f"waits for {self.name}", self.name
        return tuple(filter(None, (self.name, self.brief)))


@dataclass(slots=True)
class ResourceRow:
    """One resource or agent, or what is no module's."""

    label: str
    connected: list[Span] = field(default_factory=list)
    """When its module was."""
    handled: list[Bar] = field(default_factory=list)
    queued: list[Bar] = field(default_factory=list)
    """Messages that wait for the resource, or are suspended."""
    held: list[Bar] = field(default_factory=list)
    """Tasks that constraints hold, and that would be handled there."""
    claims: list[Bar] = field(default_factory=list)
    """Its locks and reservations."""
    is_offered: bool = False
    """Whether its module offers to handle something."""
    is_nobodys: bool = False

    @property
    def lanes(self) -> int:
        """How many lanes the handled bars need."""
        return lanes_of(self.handled) or bool(self.connected or self.claims)

    @property
    def queue_kind(self) -> str:
        """The kinds of bars in its queue, in words."""
        return " or ".join(sorted({bar.kind for bar in self.queued}))

    @property
    def is_idle(self) -> bool:
        """Whether its module was there, and nothing else happened in it."""
        return bool(self.connected) and not any(self.bars)

    @property
    def bars(self) -> Iterator[Bar]:
        """All its bars but locks and reservations."""
        return chain(self.handled, self.queued, self.held)

    def lay_out(self, start: float, end: float) -> None:
        """Keep the bars that show between two times, and give them lanes."""
        self.handled, self.queued, self.held = (
            _in_lanes([bar for bar in bars if bar.start <= end and bar.end >= start])
            for bars in (self.handled, self.queued, self.held)
        )


@dataclass(slots=True)
class Chart:
    """Rows over a span of time."""

    start: float
    end: float
    rows: list[ResourceRow]
    names: list[str]
    """Messages in the order in which they were first sent, whatever the span: a name's place tells
    its colour.
    """
    title: str = ""
    notes: Sequence[str] = ()
    """What stands below the rows."""

    def shows(self, start: float, end: float | None = None) -> bool:
        """Whether some of a span is in sight, or a moment."""
        return start <= self.end and (start if end is None else end) >= self.start

    def bars(self) -> Iterator[Bar]:
        """All bars but locks and reservations."""
        return chain.from_iterable(row.bars for row in self.rows)

    def seen(self) -> set[str]:
        """The keys of ``MEANINGS`` that the legend has to explain."""
        seen: set[str] = {CONNECTED for row in self.rows if row.is_idle}
        claims = [one for row in self.rows for one in row.claims]
        seen |= {one.kind for one in claims if self.shows(one.start, one.end)}
        for bar in self.bars():
            seen |= {bar.kind, bar.ending}
            seen |= {MARKED[mark.ending] for mark in bar.marks if self.shows(mark.time)}
            seen |= {bar.preview} if bar.ahead else set()
            seen |= {BarKind.WAITING} if bar.waits else set()
        return seen


def _in_lanes(bars: list[Bar]) -> list[Bar]:
    """The bars in the order of their starts, with their lanes: one for all that follow one bar."""
    ordered = sorted(bars, key=attrgetter("start"))
    ends = {id(bar.follows): bar.end for bar in ordered if bar.follows}
    first = [bar for bar in ordered if not bar.follows]
    spans = ((bar.start, ends.get(id(bar), bar.end)) for bar in first)
    for bar, lane in zip(first, lanes(spans), strict=True):
        bar.lane = lane
    for bar in ordered:
        if bar.follows:
            bar.lane = bar.follows.lane
    return ordered


def lanes_of(bars: list[Bar]) -> int:
    """How many lanes some bars need."""
    return max((bar.lane + 1 for bar in bars), default=0)
