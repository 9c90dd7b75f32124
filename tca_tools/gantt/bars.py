"""From a history to rows of bars: what every resource did, waited for and kept waiting. Pure; draws nothing."""

import heapq
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import chain
from math import inf
from operator import attrgetter
from typing import Any

from tca_tools.gantt import titles
from tca_tools.gantt.parts import Bar, Chart, Held, Mark, Part, Row
from tca_tools.gantt.window import ALL, Pick, span_of
from tca_tools.run.records import Claim, HandlerWait, Handling, ModuleRecord, Queueing, State, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.coping import has_coped, went_on
from tca_tools.why.stretches import in_state
from tca_wire.text.facts_in_words import place
from tca_wire.vocabulary import Outcome

NO_HANDLER = "(no handler)"
"""The row of what waits for a module that handles it."""
SUSPENDED = "(suspended)"
"""The row of suspended tasks."""
_OF_NOBODY = (("", SUSPENDED), ("", ""))
"""Below all modules, as in the viewer's chart: what is no module's may stay for long, and is little to look at."""

_HELD = (State.HELD, State.PLANNED)
"""States in which a task may not go on yet: it may not be handled, or may not be achieved."""


def chart(run: Run, start: float | None = None, end: float | None = None, pick: Pick = ALL) -> Chart:
    """What happened between *start* and *end*, a row for each resource; by default all that happened."""
    rows: dict[tuple[str, str], Row] = {}
    for module in run.modules.values():
        if pick.row(module.name):
            _add_rows(rows, run, module)
    _Filler(run, pick, rows, start, end).fill()
    bars = [bar for row in rows.values() for bar in row.bars]
    names = dict.fromkeys(chain((message.name for message in run.messages.values()), (bar.name for bar in bars)))
    start, end = span_of(list(rows.values()), run, pick, start, end)
    for row in rows.values():
        row.handled, row.queued, row.held_back = (
            _in_lanes(bars, start, end) for bars in (row.handled, row.queued, row.held_back)
        )
    shown = [row for row in _in_order(rows) if row.bars or _shows_empty(row, pick)]
    return Chart(start, end, shown, list(names))


def _in_order(rows: dict[tuple[str, str], Row]) -> Iterator[Row]:
    """Those of a module side by side, the modules in the order in which they came."""
    for module in filter(None, dict.fromkeys(module for module, _ in rows)):
        yield from (row for (name, _), row in rows.items() if name == module)
    yield from (rows[key] for key in _OF_NOBODY if key in rows)


def _shows_empty(row: Row, pick: Pick) -> bool:
    """Whether a row is shown though there is nothing in it: who only sends has one if he is asked for."""
    return pick.messages is None and bool(row.connected) and (row.is_offered or pick.modules is not None)


def _add_rows(rows: dict[tuple[str, str], Row], run: Run, module: ModuleRecord) -> None:
    """A row for each resource of a module."""
    connected = [(start, run.time if end is None else end) for start, end in module.joined]
    for resource in _resources(module):
        rows[module.name, resource] = Row(place(module.name, resource), connected, is_offered=bool(module.resources))


def _resources(module: ModuleRecord) -> list[str]:
    """Its resources; the first shows what the module waits for outside of handlers."""
    return sorted(module.resources, key=lambda resource: resource not in ("", module.name)) or [""]


class _Filler:
    """Puts bars into rows."""

    def __init__(
        self, run: Run, pick: Pick, rows: dict[tuple[str, str], Row], start: float | None, end: float | None
    ) -> None:
        self.run = run
        self.pick = pick
        self.rows = rows
        self.start = start
        self.end = end

    def fill(self) -> None:
        """Make the bars of everything that is asked for and shows."""
        for handling in self._showing(self.run.handlings):
            if self._wants(handling):
                self._row(handling.module, handling.resource).handled.append(self._handled(handling))
        for module in filter(self.pick.row, self.run.modules):
            self._add_waits(self.run.modules[module])
        for queueing in self._showing(self.run.queueings):
            if self._wants(queueing):
                self._row(queueing.module, queueing.resource).queued.append(self._queued(queueing))
        for task in self.run.tasks.values():
            self._add_kept(task)
        for claim in filter(self._wants_claim, chain.from_iterable(self.run.grants.values())):
            self._row(claim.module, claim.resource).held.append(self._held(claim))

    def _wants_claim(self, claim: Claim) -> bool:
        return self.pick.row(claim.module)

    def _wants(self, one: Handling | Queueing) -> bool:
        return self.pick.row(one.module) and self.pick.message(one.message_id)

    def _add_waits(self, module: ModuleRecord) -> None:
        """What a module waits for outside of handlers, if it has to wait for it."""
        waits = [wait for wait in self._showing(_lasting(module.waits)) if self.pick.message(wait.awaited)]
        self.rows[module.name, _resources(module)[0]].handled += [self._waited(module.name, wait) for wait in waits]

    def _showing(self, spans: Iterable[Any]) -> Iterator[Any]:
        """Those of some spans that lie between start and end."""
        start = -inf if self.start is None else self.start
        end = inf if self.end is None else self.end
        return (one for one in spans if one.start <= end and (one.end is None or one.end >= start))

    def _row(self, module: str, resource: str) -> Row:
        key = (module, resource)
        if key not in self.rows:
            self.rows[key] = Row(place(*key) if module else resource or NO_HANDLER, is_nobodys=not module)
        return self.rows[key]

    def _until(self, end: float | None) -> float:
        return self.run.time if end is None else end

    def _is_beside(self, number: int) -> bool:
        return self.pick.messages is not None and number not in self.pick.messages

    def _handled(self, handling: Handling) -> Bar:
        run, end = self.run, self._until(handling.end)
        bar = Bar(handling.name, partial(titles.handled, run, handling), handling.start, end, handling.end is None)
        bar.has_failed = handling.outcome is Outcome.FAILED
        bar.has_coped = bar.has_failed and has_coped(run, handling)
        bar.was_killed = handling.outcome is Outcome.KILLED
        bar.is_beside = self._is_beside(handling.message_id)
        bar.raised = self._raised(handling.message_id, bar)
        for wait in _lasting(handling.waits):
            until = end if wait.end is None else min(wait.end, end)
            bar.waits.append(Part(wait.start, until, partial(titles.handler_waits, run, handling, wait)))
        return bar

    def _waited(self, module: str, wait: HandlerWait) -> Bar:
        end, tell = self._until(wait.end), partial(titles.module_waits, self.run, module, wait)
        part = Part(wait.start, end, tell)
        return Bar(
            titles.awaited_name(self.run, wait), tell, wait.start, end, wait.end is None, waits=[part], is_outside=True
        )

    def _queued(self, queueing: Queueing) -> Bar:
        tell = partial(titles.queued, self.run, queueing)
        name, end = self.run.name(queueing.message_id), self._until(queueing.end)
        bar = Bar(name, tell, queueing.start, end, queueing.end is None)
        bar.is_beside = self._is_beside(queueing.message_id)
        bar.raised = self._raised(queueing.message_id, bar)
        return bar

    def _raised(self, number: int, bar: Bar) -> list[Mark]:
        """The failures that were raised on a task in a bar of it, or after its last one."""
        task = self.run.tasks.get(number)
        failures = self.run.raised.get(number, []) if task is not None else []
        if task is None or not failures:
            return []
        starts = [handling.start for handling in task.handlings] + [queueing.start for queueing in task.queueings]
        after = min((start for start in starts if start > bar.start), default=inf)
        marks = (one for one in failures if bar.start <= one.time < after)
        return [Mark(one.time, went_on(self.run, task, one.time), titles.raised(self.run, task, one)) for one in marks]

    def _add_kept(self, task: Task) -> None:
        """The spans in which a task was held, where it was or would be handled, or suspended, in a row of their own."""
        wanted = (State.SUSPENDED, *_HELD) if task.id in self.pick.held else (State.SUSPENDED,)
        if not any(state in wanted for _, state in task.states) or not self.pick.message(task.id):
            return
        ends = [*task.states[1:], (None, State.SUSPENDED)]
        for number, ((start, state), (end, _)) in enumerate(zip(task.states, ends, strict=True)):
            where = _home(self.run, task, start, end) if state in wanted else None
            if where is None or not self.pick.row(where[0]):
                continue
            if state is State.SUSPENDED:
                tell = partial(titles.suspended, self.run, task, start, end)
                self._row("", SUSPENDED).queued.append(self._kept(task, start, end, tell, is_suspended=True))
            else:
                self._row(*where).held_back += self._held_back(task, number)

    def _held_back(self, task: Task, number: int) -> list[Bar]:
        """A bar for each cause, one after the other in a lane."""
        bars: list[Bar] = []
        for part in self._showing(in_state(self.run, task, number)):
            bar = self._kept(task, part.start, part.end, partial(titles.held_back, self.run, task, part))
            bar.why = partial(titles.why_held, task, part, is_named=not bars)
            bar.first = bars[0] if bars else None
            bars.append(bar)
        if bars:
            bars[0].lasts_until = bars[-1].end
        return bars

    def _kept(
        self, task: Task, start: float, end: float | None, tell: Callable[[], str], *, is_suspended: bool = False
    ) -> Bar:
        bar = Bar(task.name, tell, start, self._until(end), end is None, is_suspended=is_suspended)
        bar.is_beside = self._is_beside(task.id)
        return bar

    def _held(self, claim: Claim) -> Held:
        start = claim.start if claim.granted is None else claim.granted
        tell = partial(titles.held, self.run, claim)
        return Held(start, self._until(claim.end), claim.is_reserved, claim.sender, claim.end is None, tell)


def _lasting(waits: Iterable[HandlerWait]) -> Iterator[HandlerWait]:
    """The waits that took any time: what was there at once is nothing to look at."""
    return (wait for wait in waits if wait.end is None or wait.end > wait.start)


def _home(run: Run, task: Task, start: float, end: float | None) -> tuple[str, str]:
    """Where a task was handled or, if it was not, would have been while it was suspended, from *start* to *end*."""
    spans: list[Handling | Queueing] = [*task.handlings[:1], *filter(attrgetter("module"), task.queueings)]
    if spans:
        return spans[0].module, spans[0].resource
    for offer in reversed(run.offers.get(task.name, [])):
        if (end is None or offer.start < end) and (offer.end is None or offer.end > start):
            return offer.module, offer.resource
    return "", ""


def _in_lanes(bars: list[Bar], start: float, end: float) -> list[Bar]:
    """The bars that show between *start* and *end*, in lanes: each in the first that is free when it starts."""
    bars = sorted((bar for bar in bars if bar.start <= end and bar.end >= start), key=lambda bar: bar.start)
    busy: list[tuple[float, int]] = []
    free: list[int] = []
    for bar in bars:
        if bar.first is not None:
            bar.lane = bar.first.lane
            continue
        while busy and busy[0][0] <= bar.start:
            heapq.heappush(free, heapq.heappop(busy)[1])
        bar.lane = heapq.heappop(free) if free else len(busy)
        heapq.heappush(busy, (max(bar.end, bar.lasts_until), bar.lane))
    return bars
