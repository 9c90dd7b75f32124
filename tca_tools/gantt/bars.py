"""From a history to rows of bars: what every resource did, waited for and kept waiting. Pure; draws nothing."""

import heapq
from dataclasses import dataclass, field
from itertools import chain

from tca_tools.history import History
from tca_tools.records import Handling, ModuleRecord, Queueing, Wait
from tca_wire.vocabulary import Outcome
from tca_wire.wording import place

NO_HANDLER = "(no handler)"
"""The row of what waits for a module that handles it."""

_ROOM = 0.02


@dataclass(slots=True)
class Part:
    """A part of a bar: its handler waits."""

    start: float
    end: float
    title: str


@dataclass(slots=True)
class Bar:
    """A message in a resource: handled, waited for outside of a handler, or queued."""

    name: str
    title: str
    """All there is to say about it."""
    start: float
    end: float
    is_open: bool
    """Whether it went on when the journal ended."""
    has_failed: bool = False
    waits: list[Part] = field(default_factory=list)
    lane: int = 0
    """Bars of one lane do not overlap."""


@dataclass(slots=True)
class Row:
    """One resource."""

    label: str
    connected: list[tuple[float, float]] = field(default_factory=list)
    handled: list[Bar] = field(default_factory=list)
    queued: list[Bar] = field(default_factory=list)

    @property
    def lanes(self) -> int:
        """How many lanes the handled bars need."""
        return max((bar.lane + 1 for bar in self.handled), default=1 if self.connected else 0)

    @property
    def queue_lanes(self) -> int:
        """How many lanes the queued bars need."""
        return max((bar.lane + 1 for bar in self.queued), default=0)


@dataclass(slots=True)
class Chart:
    """Rows over a span of time."""

    start: float
    end: float
    rows: list[Row]
    names: list[str]
    """Messages in the order in which they were first sent, whatever the span: a name's place tells its colour."""


def chart(history: History, start: float | None = None, end: float | None = None) -> Chart:
    """What happened between *start* and *end*, a row for each resource; by default from the first bar to the last."""
    rows: dict[tuple[str, str], Row] = {}
    for module in history.modules.values():
        _add_rows(rows, history, module)
    for handling in history.handlings:
        rows[handling.module, handling.resource].handled.append(_handled(history, handling))
    for queueing in history.queueings:
        _queue_row(rows, queueing).queued.append(_queued(history, queueing))
    bars = [bar for row in rows.values() for bar in (*row.handled, *row.queued)]
    names = dict.fromkeys(chain((message.name for message in history.messages.values()), (bar.name for bar in bars)))
    start, end = _span_of(bars, history.time, start, end)
    for row in rows.values():
        row.handled, row.queued = (_in_lanes(bars, start, end) for bars in (row.handled, row.queued))
    return Chart(start, end, list(rows.values()), list(names))


def _span_of(bars: list[Bar], now: float, start: float | None, end: float | None) -> tuple[float, float]:
    """From when until when the chart goes: what was not asked for is where the bars are, with a little room."""
    first = min((bar.start for bar in bars), default=0.0)
    last = max((bar.end for bar in bars), default=now)
    room = (last - first) * _ROOM
    start = max(first - room, 0.0) if start is None else start
    end = min(last + room, now) if end is None else end
    return start, max(end, start)


def _add_rows(rows: dict[tuple[str, str], Row], history: History, module: ModuleRecord) -> None:
    """A row for each resource of a module; the first shows what the module waits for outside of handlers."""
    connected = [(start, history.time if end is None else end) for start, end in module.joined]
    resources = sorted(module.resources, key=lambda resource: resource not in ("", module.name)) or [""]
    for resource in resources:
        rows[module.name, resource] = Row(place(module.name, resource), connected)
    rows[module.name, resources[0]].handled += [_waited(history, module.name, wait) for wait in module.waits]


def _queue_row(rows: dict[tuple[str, str], Row], queueing: Queueing) -> Row:
    key = (queueing.module, queueing.resource)
    if key not in rows:
        rows[key] = Row(place(*key) if queueing.module else NO_HANDLER)
    return rows[key]


def _handled(history: History, handling: Handling) -> Bar:
    end = history.time if handling.end is None else handling.end
    where, message = place(handling.module, handling.resource), _described(history, handling)
    title = f"{message} handled by {where} {_span(handling.start, handling.end, end)}"
    if handling.outcome and handling.outcome is not Outcome.DONE:
        title += f": {handling.outcome}"
    waits = [
        Part(wait.start, end if wait.end is None else min(wait.end, end), f"{message} {_waits_for(history, wait)}")
        for wait in handling.waits
    ]
    has_failed = handling.outcome is Outcome.FAILED
    return Bar(handling.name, title, handling.start, end, handling.end is None, has_failed, waits)


def _described(history: History, handling: Handling) -> str:
    if handling.direct_from:
        return f"{handling.name}, directly from {handling.direct_from},"
    return history.describe(handling.message_id)


def _waited(history: History, module: str, wait: Wait) -> Bar:
    end = history.time if wait.end is None else wait.end
    title = f"{module} {_waits_for(history, wait)}"
    part = Part(wait.start, end, title)
    return Bar(history.name(wait.awaited), title, wait.start, end, wait.end is None, waits=[part])


def _queued(history: History, queueing: Queueing) -> Bar:
    end = history.time if queueing.end is None else queueing.end
    where = place(queueing.module, queueing.resource) or "a handler"
    title = f"{history.describe(queueing.message_id)} queued for {where} {_span(queueing.start, queueing.end, end)}"
    return Bar(history.name(queueing.message_id), title, queueing.start, end, queueing.end is None)


def _waits_for(history: History, wait: Wait) -> str:
    what = history.describe(wait.awaited)
    until = history.time if wait.end is None else wait.end
    return f"waits for {what} {_span(wait.start, wait.end, until)}"


def _span(start: float, end: float | None, until: float) -> str:
    return f"from {start:.3f} s" + (" on" if end is None else f" to {end:.3f} s") + f", {until - start:.3f} s"


def _in_lanes(bars: list[Bar], start: float, end: float) -> list[Bar]:
    """The bars that show between *start* and *end*, in lanes: each in the first that is free when it starts."""
    bars = sorted((bar for bar in bars if bar.start <= end and bar.end >= start), key=lambda bar: bar.start)
    busy: list[tuple[float, int]] = []
    free: list[int] = []
    for bar in bars:
        while busy and busy[0][0] <= bar.start:
            heapq.heappush(free, heapq.heappop(busy)[1])
        bar.lane = heapq.heappop(free) if free else len(busy)
        heapq.heappush(busy, (bar.end, bar.lane))
    return bars
