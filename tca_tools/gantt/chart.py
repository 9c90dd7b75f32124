"""The parts of a chart: rows of bars with their titles and marks."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import chain
from math import inf
from operator import attrgetter

from tca_tools.journal.records import Restart
from tca_tools.spans import Span, lanes
from tca_tools.terminal import cut
from tca_wire.coordination import TaskRole
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Outcome

_FEWEST = 8
"""The fewest columns in which a reason is shown."""


class BarKind(StrEnum):
    """The kinds of bars."""

    HANDLED = "handling"
    AWAITED = "awaited"  # a wait of a module outside of handlers
    IDLE = "idle"  # an agent has no task
    WAITING = "waiting"  # the part of a bar in which its handler waits
    QUEUED = "queued"
    SUSPENDED = "suspended"
    HELD = "held"
    LOCKED = "locked"
    RESERVED = "reserved"


class Ending(StrEnum):
    """The outcome of a handler that did not succeed, or of a failure."""

    NONE = ""
    FAILED = "failed"
    HANDLED = "handled"  # it failed, and the run continued
    RESOLVED = "resolved"  # it failed, and its task was done after the failure
    KILLED = "killed"  # its task was killed while it ran


CONNECTED, CURVE = "connected", "curve"
MARKED = {Ending.FAILED: "mark-failed", Ending.HANDLED: "mark-handled", Ending.NONE: "mark-request"}
"""The style names of marks."""
FLAGGED = (Ending.FAILED, Ending.HANDLED, Ending.RESOLVED)
"""The endings that have a flag, the worst first."""
RESTART = "restart"
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
    TaskRole.WASTED: "ahead, but wasted",
    Ending.FAILED: "failed",
    Ending.HANDLED: "failed, and handled",
    Ending.RESOLVED: str(Outcome.RESOLVED),
    Ending.KILLED: "killed",
    "mark-failed": "failure raised from outside the handler",
    "mark-handled": "failure raised from outside the handler, and handled",
    "mark-request": "request of a client, or its answer",
    CURVE: "number queued or suspended",
    RESTART: "central was restarted",
    "flag-failed": "a failure at this time",
    "flag-handled": "a failure at this time, handled",
    "flag-resolved": f"a failure at this time, task {Outcome.RESOLVED}",
}
"""The legend of a chart: by style name (see ``chart.css``), the meaning."""


@dataclass(frozen=True, slots=True)
class Mark:
    """An instant in a bar: a failure from outside the handler, or a client's request or answer."""

    time: float
    ending: Ending
    title: str


@dataclass(slots=True)
class Bar:
    """A span of time in a row. The bar of a lock or reservation has its holder's name."""

    name: str
    start: float
    end: float
    title: Callable[[], str] = str
    """Returns its full description, which a picture shows under the mouse pointer."""
    kind: BarKind = BarKind.HANDLED
    is_open: bool = False
    """Whether it had not ended when the journal ended."""
    is_unselected: bool = False
    """Whether it was not selected itself, but a selected task waited for it. Then it is paler."""
    ending: Ending = Ending.NONE
    waits: "Sequence[Bar]" = ()
    marks: Sequence[Mark] = ()
    why: Callable[[], str] | None = None
    """For a held task: returns what it waits for, a text on the bar if there is room."""
    lane_leader: "Bar | None" = None
    """For a later bar of a held task: the first bar, whose lane it shares."""
    lane: int = 0
    """The number of its lane; bars of one lane do not overlap."""
    early_until: float = -inf
    """For early work of a coordinator: the time at which its state was entered."""
    is_wasted: bool = False
    """Whether early work was wasted."""
    short_label: str = ""
    """The label if the name does not fit."""
    parts: "Sequence[Bar]" = ()
    """For a block: the bars that it combines."""

    @property
    def early_span(self) -> tuple[float, float] | None:
        """The span of early work; None without any."""
        if self.early_until <= self.start:
            return None
        return self.start, min(self.end, self.early_until)

    @property
    def early_style(self) -> TaskRole:
        """The style of the span of early work."""
        return TaskRole.WASTED if self.is_wasted else TaskRole.AHEAD

    @property
    def seconds(self) -> float:
        """Its length in seconds; for a block, the sum of its bars."""
        if self.parts:
            return sum(part.seconds for part in self.parts)
        return self.end - self.start

    @property
    def ended_at(self) -> float | None:
        """The time of its end; None if it had not ended when the journal ended."""
        return None if self.is_open else self.end

    @property
    def is_waiting(self) -> bool:
        """Whether its handler waited for most of the time, so that a narrow bar looks paler."""
        return 2 * sum(wait.seconds for wait in self.waits) > self.seconds

    def reason(self, columns: int) -> str:
        """Return why the task is held, in at most *columns* columns; "" if they are too few."""
        if self.why is None or columns < _FEWEST:
            return ""
        return cut(printable(self.why()), columns)

    @property
    def labels(self) -> tuple[str, ...]:
        """The possible labels, the best first: ``waits for walk``, ``walk``."""
        if self.kind is BarKind.AWAITED:
            return f"waits for {self.name}", self.name
        return tuple(filter(None, (self.name, self.short_label)))


@dataclass(slots=True)
class ResourceRow:
    """The row of a resource or agent, or of messages without a module."""

    label: str
    connected: list[Span] = field(default_factory=list)
    """The spans in which its module was connected."""
    handled: list[Bar] = field(default_factory=list)
    queued: list[Bar] = field(default_factory=list)
    """Messages that wait for the resource, or suspended tasks."""
    held: list[Bar] = field(default_factory=list)
    """Tasks for this resource that constraints hold."""
    claims: list[Bar] = field(default_factory=list)
    """Its locks and reservations."""
    has_handlers: bool = False
    """Whether its module has a handler."""
    is_without_module: bool = False
    """Whether it is the row of suspended tasks, or of messages without a handler."""

    @property
    def lanes(self) -> int:
        """The number of lanes that the handled bars need."""
        return lanes_of(self.handled) or bool(self.connected or self.claims)

    @property
    def queue_kind(self) -> str:
        """The kinds of bars in its queue, in words."""
        return " or ".join(sorted({bar.kind for bar in self.queued}))

    @property
    def is_idle(self) -> bool:
        """Whether its module was connected, and the row has no bars."""
        return bool(self.connected) and not any(self.bars)

    @property
    def bars(self) -> Iterator[Bar]:
        """All its bars except locks and reservations."""
        return chain(self.handled, self.queued, self.held)

    def lay_out(self, start: float, end: float) -> None:
        """Remove the bars outside of the times, and assign lanes to the others."""
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
    """All messages of the run, in the order in which they were first sent.

    The place of a name determines its colour, so that the colours do not depend on the span.
    """
    title: str = ""
    notes: Sequence[str] = ()
    """Lines of text below the rows."""
    restarts: Sequence[Restart] = ()
    """The restarts of central in the chart."""

    def shows(self, start: float, end: float | None = None) -> bool:
        """Whether an instant, or a part of a span, lies in the chart."""
        return start <= self.end and (start if end is None else end) >= self.start

    def bars(self) -> Iterator[Bar]:
        """Return all bars except locks and reservations."""
        return chain.from_iterable(row.bars for row in self.rows)

    def legend_keys(self) -> set[str]:
        """Return the keys of ``MEANINGS`` that the legend must explain."""
        seen: set[str] = {CONNECTED for row in self.rows if row.is_idle}
        seen |= {RESTART} if self.restarts else set()
        claims = [claim for row in self.rows for claim in row.claims]
        seen |= {claim.kind for claim in claims if self.shows(claim.start, claim.end)}
        for bar in self.bars():
            seen |= {bar.kind, bar.ending}
            seen |= {MARKED[mark.ending] for mark in bar.marks if self.shows(mark.time)}
            seen |= {bar.early_style} if bar.early_span else set()
            seen |= {BarKind.WAITING} if bar.waits else set()
        return seen


def _in_lanes(bars: list[Bar]) -> list[Bar]:
    """Sort bars by their starts, and assign lanes; bars with a leader get the leader's lane."""
    ordered = sorted(bars, key=attrgetter("start"))
    ends = {id(bar.lane_leader): bar.end for bar in ordered if bar.lane_leader}
    first = [bar for bar in ordered if not bar.lane_leader]
    spans = ((bar.start, ends.get(id(bar), bar.end)) for bar in first)
    for bar, lane in zip(first, lanes(spans), strict=True):
        bar.lane = lane
    for bar in ordered:
        if bar.lane_leader:
            bar.lane = bar.lane_leader.lane
    return ordered


def lanes_of(bars: list[Bar]) -> int:
    """Return the number of lanes that bars need."""
    return max((bar.lane + 1 for bar in bars), default=0)
