"""From a history to rows of bars: what every resource did, waited for and kept waiting. Pure; draws nothing."""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import chain, pairwise
from math import inf
from operator import attrgetter
from typing import Any

from tca_tools.explain.waits import told_waits
from tca_tools.gantt import titles
from tca_tools.gantt.chart import Bar, BarKind, Chart, Ending, Mark, ResourceRow
from tca_tools.gantt.window import ALL, Pick, span_of
from tca_tools.journal.coordinators import agent_task
from tca_tools.journal.fates import has_coped, went_on
from tca_tools.journal.records import HandlerWait, Handling, ModuleRecord, Queueing, Task, TaskState
from tca_tools.journal.whole_run import Run
from tca_tools.spans import lanes
from tca_wire.life_cycles import Effect
from tca_wire.text.facts_in_words import place
from tca_wire.vocabulary import Outcome

NO_HANDLER = "(no handler)"
"""The row of what waits for a module that handles it."""
SUSPENDED = "(suspended)"
"""The row of suspended tasks."""
_HELD = (TaskState.HELD, TaskState.PLANNED)
"""States in which a task may not go on yet: it may not be handled, or may not be achieved."""


def chart(run: Run, start: float | None = None, end: float | None = None, pick: Pick = ALL) -> Chart:
    """The chart from *start* to *end*, a row for each resource; by default of all that happened."""
    rows = _Filler(run, pick, start, end).filled()
    names = dict.fromkeys(message.name for message in run.messages.values())
    names |= dict.fromkeys(bar.name for row in rows.values() for bar in row.bars)
    start, end = span_of(list(rows.values()), run, pick, start, end)
    for row in rows.values():
        row.handled = _laid_out(row.handled, start, end)
        row.queued = _laid_out(row.queued, start, end)
        row.held = _laid_out(row.held, start, end)
    modules = list(dict.fromkeys(module for module, _ in rows if module))  # rows of a module stand side by side
    keys = sorted(rows, key=lambda key: modules.index(key[0]) if key[0] else len(modules) + (key == ("", "")))
    shown = [rows[key] for key in keys if any(rows[key].bars) or _shows_empty(rows[key], pick)]
    return Chart(start, end, shown, list(names))


def _shows_empty(row: ResourceRow, pick: Pick) -> bool:
    """Whether an empty row is shown: that of a module that only sends has to be asked for."""
    return pick.messages is None and bool(row.connected) and (row.is_offered or pick.modules is not None)


def _laid_out(bars: list[Bar], start: float, end: float) -> list[Bar]:
    """The bars that show between *start* and *end*, with their lanes."""
    shown = sorted((bar for bar in bars if bar.start <= end and bar.end >= start), key=attrgetter("start"))
    chains: dict[int, list[Bar]] = {id(bar.follows): [] for bar in shown if bar.follows}
    for bar in shown:
        if (some := chains.get(id(bar.follows or bar))) is not None:
            some.append(bar)
    followers = {id(bar) for some in chains.values() for bar in some[1:]}
    first = [bar for bar in shown if id(bar) not in followers]
    ends = {id(some[0]): some[-1].end for some in chains.values()}
    for bar, lane in zip(first, lanes((bar.start, ends.get(id(bar), bar.end)) for bar in first), strict=True):
        bar.lane = lane
    for some in chains.values():
        for bar in some[1:]:
            bar.lane = some[0].lane
    return shown


def _resources(module: ModuleRecord) -> list[str]:
    """Its resources; the first shows what the module waits for outside of handlers."""
    return sorted(module.resources, key=lambda resource: resource not in ("", module.name)) or [""]


class _Filler:
    """Puts bars into rows."""

    def __init__(self, run: Run, pick: Pick, start: float | None, end: float | None) -> None:
        self.run = run
        self.pick = pick
        self.start = -inf if start is None else start
        self.end = inf if end is None else end
        self.rows: dict[tuple[str, str], ResourceRow] = {}

    def filled(self) -> dict[tuple[str, str], ResourceRow]:
        """The rows, with the bars of everything that is asked for and shows."""
        run, modules = self.run, [one for one in self.run.modules.values() if self.pick.row(one.name)]
        for module in modules:
            for resource in _resources(module):
                row = self._row(module.name, resource)
                row.connected = [(start, self._until(end)) for start, end in module.joined]
                row.is_offered = bool(module.resources)
        for handling in filter(self._wants, self._showing(run.handlings)):
            self._row(handling.module, handling.resource).handled.append(self._handled(handling))
        for module in modules:  # what it waits for outside of handlers
            waits = (wait for wait in self._showing(_lasting(module.waits)) if self.pick.message(wait.awaited))
            row = self._row(module.name, _resources(module)[0])
            row.handled += [self._awaited(module.name, wait) for wait in waits]
        for queueing in filter(self._wants, self._showing(run.queueings)):
            number = queueing.message_id
            span = run.name(number), queueing.start, queueing.end
            bar = self._bar(BarKind.QUEUED, *span, titles.queued, queueing, of=number)
            bar.marks = self._marks(number, bar)
            self._row(queueing.module, queueing.resource).queued.append(bar)
        for task in run.tasks.values():
            self._add_kept(task)
        for claim in chain.from_iterable(run.grants.values()):
            if self.pick.row(claim.module):
                kind = BarKind.RESERVED if claim.is_reserved else BarKind.LOCKED
                start = claim.start if claim.granted is None else claim.granted
                bar = self._bar(kind, claim.sender, start, claim.end, titles.claimed, claim)
                self._row(claim.module, claim.resource).claims.append(bar)
        return self.rows

    def _row(self, module: str, resource: str) -> ResourceRow:
        key = (module, resource)
        if key not in self.rows:
            self.rows[key] = ResourceRow(place(*key) if module else resource or NO_HANDLER, is_nobodys=not module)
        return self.rows[key]

    def _wants(self, one: Handling | Queueing) -> bool:
        return self.pick.row(one.module) and self.pick.message(one.message_id)

    def _showing(self, spans: Iterable[Any]) -> Iterator[Any]:
        """Those of some spans that lie between start and end."""
        return (one for one in spans if one.start <= self.end and (one.end is None or one.end >= self.start))

    def _until(self, end: float | None) -> float:
        return self.run.time if end is None else end

    def _bar(
        self, kind: BarKind, name: str, start: float, end: float | None, title: Any, *about: Any, of: int | None = None
    ) -> Bar:
        """A bar *of* a message; *title* tells of the run *about* what."""
        is_beside = of is not None and self.pick.messages is not None and of not in self.pick.messages
        return Bar(name, start, self._until(end), title, (self.run, *about), kind, end is None, is_beside)

    def _handled(self, one: Handling) -> Bar:
        bar = self._bar(BarKind.HANDLED, one.name, one.start, one.end, titles.handled, one, of=one.message_id)
        if one.outcome is Outcome.FAILED:
            bar.ending = self._failed(one)
        elif one.outcome is Outcome.KILLED:
            bar.ending = Ending.KILLED
        who = titles.described(self.run, one)
        for wait in _lasting(one.waits):
            part = self._bar(BarKind.WAITING, one.name, wait.start, wait.end, titles.waits, who, wait)
            part.end = min(part.end, bar.end)
            bar.waits = [*bar.waits, part]
        bar.marks = self._marks(one.message_id, bar)
        task = self.run.tasks.get(one.message_id)
        if task is not None and (sent := agent_task(self.run, task)) and sent.is_early:
            bar.ahead_until, bar.is_wasted = sent.entered, sent.is_wasted
        return bar

    def _failed(self, one: Handling) -> Ending:
        task = self.run.tasks.get(one.message_id)
        is_last = task is not None and any(last is one for last in task.handlings[-1:])
        if is_last and task is not None and task.state is TaskState.RESOLVED:
            return Ending.RESOLVED
        return Ending.COPED if has_coped(self.run, one) else Ending.FAILED

    def _awaited(self, module: str, wait: HandlerWait) -> Bar:
        what = (titles.awaited_name(self.run, wait), wait.start, wait.end, titles.waits, module, wait)
        bar = self._bar(BarKind.AWAITED, *what)
        bar.waits = [self._bar(BarKind.WAITING, *what)]
        return bar

    def _marks(self, number: int, bar: Bar) -> list[Mark]:
        """The failures raised on a task and the requests of its clients, in a bar of it or after the last one."""
        run, task, failures = self.run, self.run.tasks.get(number), self.run.raised.get(number, ())
        if task is None or not (failures or task.life):
            return []
        starts = (one.start for one in (*task.handlings, *task.queueings) if one.start > bar.start)
        after = min(starts, default=inf)
        endings = {True: Ending.COPED, False: Ending.FAILED}
        marks = [
            Mark(one.time, endings[went_on(run, task, one.time)], titles.raised(run, task, one)) for one in failures
        ]
        marks += [
            Mark(one.time, Ending.NONE, titles.changed(task, one))
            for one in task.life
            if one.effect is not Effect.RESULT
        ]
        return [one for one in marks if bar.start <= one.time < after]

    def _add_kept(self, task: Task) -> None:
        """The spans in which a task was held, where it was or would be handled, or suspended, in a row of their own."""
        wanted = (TaskState.SUSPENDED, *_HELD) if task.id in self.pick.held else (TaskState.SUSPENDED,)
        if not any(state in wanted for *_, state in task.spans()) or not self.pick.message(task.id):
            return
        for start, end, state in task.spans():
            where = _home(self.run, task, start, end) if state in wanted else None
            if where is None or not self.pick.row(where[0]):
                continue
            if state is TaskState.SUSPENDED:
                span = (start, None if end == inf else end)
                bar = self._bar(BarKind.SUSPENDED, task.name, *span, titles.suspended, task, *span, of=task.id)
                self._row("", SUSPENDED).queued.append(bar)
            else:
                self._row(*where).held += self._held(task, start, end)

    def _held(self, task: Task, start: float, end: float) -> list[Bar]:
        """A bar for each cause, one after the other in a lane."""
        waits = [wait for wait in told_waits(self.run, task) if start <= wait.start < end]
        stops = sorted({start, *(wait.start for wait in waits), *(wait.end for wait in waits if wait.end < end)})
        bars: list[Bar] = []
        for since, until in pairwise([*stops, end]):
            if since > self.end or until < self.start:
                continue
            some = [wait for wait in waits if wait.start <= since < wait.end]
            span = (since, None if until == inf else until)
            bar = self._bar(BarKind.HELD, task.name, *span, titles.held, task, *span, some, of=task.id)
            bar.why = partial(titles.why_held, self.run, "" if bars else f"{task}: ", since, some)
            bar.follows = bars[0] if bars else None
            bars.append(bar)
        return bars


def _lasting(waits: Iterable[HandlerWait]) -> Iterator[HandlerWait]:
    """The waits that took any time: what was there at once is nothing to look at."""
    return (wait for wait in waits if wait.end is None or wait.end > wait.start)


def _home(run: Run, task: Task, start: float, end: float) -> tuple[str, str]:
    """Where a task was handled or, if it was not, would have been while it was kept, from *start* to *end*."""
    spans: list[Handling | Queueing] = [*task.handlings[:1], *filter(attrgetter("module"), task.queueings)]
    if spans:
        return spans[0].module, spans[0].resource
    for offer in reversed(run.offers.get(task.name, [])):
        if offer.start < end and (offer.end is None or offer.end > start):
            return offer.module, offer.resource
    return "", ""
