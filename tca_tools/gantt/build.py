"""From a history to rows of bars: what every resource did, waited for and kept waiting. Pure; draws
nothing.
"""

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
from tca_tools.journal.records import (
    Claim,
    HandlerWait,
    Handling,
    ModuleRecord,
    Queueing,
    Task,
    TaskState,
)
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Span
from tca_wire.life_cycles import Effect
from tca_wire.text.facts_in_words import place
from tca_wire.vocabulary import Outcome

NO_HANDLER = "(no handler)"
"""The row of what waits for a module that handles it."""
SUSPENDED = "(suspended)"
"""The row of suspended tasks."""
_HELD = (TaskState.HELD, TaskState.PLANNED)
"""States in which a task may not go on yet: it may not be handled, or may not be achieved."""


def chart(
    run: Run, start: float | None = None, end: float | None = None, pick: Pick = ALL
) -> Chart:
    """The chart from *start* to *end*, a row for each resource; by default of all that happened."""
    window = (-inf if start is None else start, inf if end is None else end)
    rows = _Filler(run, pick, window).filled()
    names = dict.fromkeys(message.name for message in run.messages.values())
    names |= dict.fromkeys(bar.name for row in rows.values() for bar in row.bars)
    start, end = span_of(list(rows.values()), run, pick, start, end)
    for row in rows.values():
        row.lay_out(start, end)
    modules = list(
        dict.fromkeys(module for module, _ in rows if module)
    )  # rows of a module stand side by side
    places = {module: place for place, module in enumerate([*modules, ""])}
    keys = sorted(rows, key=lambda key: (places[key[0]], key == ("", "")))
    shown = (rows[key] for key in keys)
    return Chart(
        start, end, [row for row in shown if any(row.bars) or _shows_empty(row, pick)], list(names)
    )


def _shows_empty(row: ResourceRow, pick: Pick) -> bool:
    """Whether an empty row is shown: that of a module that only sends has to be asked for."""
    is_wanted = row.is_offered or pick.modules is not None
    return is_wanted and pick.messages is None and bool(row.connected)


class _Filler:
    """Puts bars into rows."""

    def __init__(self, run: Run, pick: Pick, window: Span) -> None:
        self.run = run
        self.pick = pick
        self.start, self.end = window
        self.rows: dict[tuple[str, str], ResourceRow] = {}

    def filled(self) -> dict[tuple[str, str], ResourceRow]:
        """The rows, with the bars of everything that is asked for and shows."""
        run = self.run
        modules = [one for one in run.modules.values() if self.pick.row(one.name)]
        for module in modules:
            self._add_module(module)
        for handling in self._wanted(run.handlings):
            self._row(handling.module, handling.resource).handled.append(self._handled(handling))
        for module in modules:  # what it waits for outside of handlers
            waits = (
                wait
                for wait in self._showing(_lasting(module.waits))
                if self.pick.message(wait.awaited)
            )
            awaited = [self._awaited(module.name, wait) for wait in waits]
            self._row(module.name, _resources(module)[0]).handled += awaited
        for queueing in self._wanted(run.queueings):
            self._row(queueing.module, queueing.resource).queued.append(self._queued(queueing))
        for task in run.tasks.values():
            self._add_kept(task)
        for claim in chain.from_iterable(run.grants.values()):
            if self.pick.row(claim.module):
                self._row(claim.module, claim.resource).claims.append(self._claimed(claim))
        return self.rows

    def _add_module(self, module: ModuleRecord) -> None:
        """Its rows, as long as they are empty."""
        for resource in _resources(module):
            row = self._row(module.name, resource)
            row.connected = [
                (start, self.run.time if end is None else end) for start, end in module.joined
            ]
            row.is_offered = bool(module.resources)

    def _row(self, module: str, resource: str) -> ResourceRow:
        key = (module, resource)
        if key not in self.rows:
            self.rows[key] = ResourceRow(
                place(*key) if module else resource or NO_HANDLER, is_nobodys=not module
            )
        return self.rows[key]

    def _wanted(self, some: Iterable[Any]) -> Iterator[Any]:
        """Those of some handlings or queueings that are asked for."""
        for one in self._showing(some):
            if self.pick.row(one.module) and self.pick.message(one.message_id):
                yield one

    def _showing(self, spans: Iterable[Any]) -> Iterator[Any]:
        """Those of some spans that lie between start and end."""
        for one in spans:
            if one.start <= self.end and (one.end is None or one.end >= self.start):
                yield one

    # --- single bars ------------------------------------------------------------------------------

    def _bar(
        self, kind: BarKind, name: str, start: float, end: float | None, of: int | None = None
    ) -> Bar:
        """A bar *of* a message, without its title."""
        until = self.run.time if end is None else end
        is_beside = of is not None and not self.pick.is_asked(of)
        return Bar(name, start, until, kind=kind, is_open=end is None, is_beside=is_beside)

    def _handled(self, one: Handling) -> Bar:
        bar = self._bar(BarKind.HANDLED, one.name, one.start, one.end, one.message_id)
        bar.title = partial(titles.handled, self.run, one)
        if one.outcome is Outcome.FAILED:
            bar.ending = self._failed(one)
        elif one.outcome is Outcome.KILLED:
            bar.ending = Ending.KILLED
        who = titles.described(self.run, one)
        bar.waits = [self._wait(who, one.name, wait) for wait in _lasting(one.waits)]
        for part in bar.waits:
            part.end = min(part.end, bar.end)
        bar.marks = self._marks(one.message_id, bar)
        task = self.run.tasks.get(one.message_id)
        if task is not None and (sent := agent_task(self.run, task)) and sent.is_early:
            bar.ahead_until, bar.is_wasted = sent.entered, sent.is_wasted
        return bar

    def _failed(self, one: Handling) -> Ending:
        task = self.run.tasks.get(one.message_id)
        if task and task.state is TaskState.RESOLVED and task.handlings[-1] is one:
            return Ending.RESOLVED
        return Ending.COPED if has_coped(self.run, one) else Ending.FAILED

    def _wait(self, who: str, name: str, wait: HandlerWait, kind: BarKind = BarKind.WAITING) -> Bar:
        bar = self._bar(kind, name, wait.start, wait.end)
        bar.title = partial(titles.waits, self.run, who, wait)
        return bar

    def _awaited(self, module: str, wait: HandlerWait) -> Bar:
        name = titles.awaited_name(self.run, wait)
        bar = self._wait(module, name, wait, BarKind.AWAITED)
        bar.waits = [self._wait(module, name, wait)]
        return bar

    def _queued(self, one: Queueing) -> Bar:
        number = one.message_id
        bar = self._bar(BarKind.QUEUED, self.run.name(number), one.start, one.end, number)
        bar.title = partial(titles.queued, self.run, one)
        bar.marks = self._marks(number, bar)
        return bar

    def _claimed(self, claim: Claim) -> Bar:
        kind = BarKind.RESERVED if claim.is_reserved else BarKind.LOCKED
        start = claim.start if claim.granted is None else claim.granted
        bar = self._bar(kind, claim.sender, start, claim.end)
        bar.title = partial(titles.claimed, self.run, claim, start)
        return bar

    def _marks(self, number: int, bar: Bar) -> list[Mark]:
        """The failures raised on a task and the requests of its clients, in a bar of it or after
        the last one.
        """
        run, task = self.run, self.run.tasks.get(number)
        failures = run.raised.get(number, ())
        if task is None or not (failures or task.life):
            return []
        marks = []
        for one in failures:
            ending = Ending.COPED if went_on(run, task, one.time) else Ending.FAILED
            marks.append(Mark(one.time, ending, titles.raised(run, task, one)))
        changes = (one for one in task.life if one.effect is not Effect.RESULT)
        marks += [Mark(one.time, Ending.NONE, titles.changed(task, one)) for one in changes]
        starts = [one.start for one in (*task.handlings, *task.queueings)]
        after = min((start for start in starts if start > bar.start), default=inf)
        return [one for one in marks if bar.start <= one.time < after]

    # --- what is kept from going on ---------------------------------------------------------------

    def _add_kept(self, task: Task) -> None:
        """The spans in which a task was held, where it was or would be handled, or suspended, in a
        row of their own.
        """
        wanted = [TaskState.SUSPENDED]
        if task.id in self.pick.held:
            wanted += _HELD
        spans = [span for span in task.spans() if span[2] in wanted]
        if not spans or not self.pick.message(task.id):
            return
        for start, end, state in spans:
            module, resource = _home(self.run, task, start, end)
            if not self.pick.row(module):
                continue
            if state is TaskState.SUSPENDED:
                bar = self._kept(BarKind.SUSPENDED, task, start, end)
                bar.title = partial(titles.suspended, self.run, task, start, bar.until)
                self._row("", SUSPENDED).queued.append(bar)
            else:
                self._row(module, resource).held += self._held(task, start, end)

    def _kept(self, kind: BarKind, task: Task, start: float, end: float) -> Bar:
        return self._bar(kind, task.name, start, None if end == inf else end, task.id)

    def _held(self, task: Task, start: float, end: float) -> list[Bar]:
        """A bar for each cause, one after the other in a lane."""
        waits = [wait for wait in told_waits(self.run, task) if start <= wait.start < end]
        starts, ends = (
            (wait.start for wait in waits),
            (wait.end for wait in waits if wait.end < end),
        )
        stops = sorted({start, *starts, *ends})
        bars: list[Bar] = []
        for since, until in pairwise([*stops, end]):
            if since > self.end or until < self.start:
                continue
            some = [wait for wait in waits if wait.start <= since < wait.end]
            bar = self._kept(BarKind.HELD, task, since, until)
            bar.title = partial(titles.held, self.run, task, since, bar.until, some)
            who = "" if bars else f"{task}: "
            bar.why = partial(titles.why_held, self.run, who, since, some)
            bar.follows = bars[0] if bars else None
            bars.append(bar)
        return bars


def _resources(module: ModuleRecord) -> list[str]:
    """Its resources; the first shows what the module waits for outside of handlers."""
    return sorted(module.resources, key=lambda resource: resource not in ("", module.name)) or [""]


def _lasting(waits: Iterable[HandlerWait]) -> Iterator[HandlerWait]:
    """The waits that took any time: what was there at once is nothing to look at."""
    return (wait for wait in waits if wait.end is None or wait.end > wait.start)


def _home(run: Run, task: Task, start: float, end: float) -> tuple[str, str]:
    """Where a task was handled or, if it was not, would have been while it was kept, from *start*
    to *end*.
    """
    spans: list[Handling | Queueing] = [
        *task.handlings[:1],
        *filter(attrgetter("module"), task.queueings),
    ]
    if spans:
        return spans[0].module, spans[0].resource
    for offer in reversed(run.offers.get(task.name, [])):
        if offer.start < end and (offer.end is None or offer.end > start):
            return offer.module, offer.resource
    return "", ""
