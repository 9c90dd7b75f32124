"""Build the rows of a chart from a run: what each resource handled, waited for and queued."""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import chain, pairwise
from math import inf
from typing import Any

from tca_tools.explain.waits import waits_for_display
from tca_tools.gantt import titles
from tca_tools.gantt.chart import Bar, BarKind, Chart, Ending, Mark, ResourceRow
from tca_tools.gantt.window import ALL, Pick, span_of
from tca_tools.journal.coordinators import sent_by_coordinator
from tca_tools.journal.fates import run_continued, run_continued_after
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
"""The row of messages that wait until a module handles them."""
SUSPENDED = "(suspended)"
"""The row of suspended tasks."""
_HELD = (TaskState.HELD, TaskState.PLANNED)
"""States in which constraints hold a task's handling, or its achievement."""


def chart(
    run: Run, start: float | None = None, end: float | None = None, pick: Pick = ALL
) -> Chart:
    """Return the chart of a run, with a row for each resource.

    Args:
        run: The run.
        start: Seconds since the start of the run; by default where the first bar begins.
        end: Seconds since the start of the run; by default where the last bar ends.
        pick: The bars to include; all by default.
    """
    window = (-inf if start is None else start, inf if end is None else end)
    rows = _RowBuilder(run, pick, window).build()
    names = dict.fromkeys(message.name for message in run.messages.values())
    names |= dict.fromkeys(bar.name for row in rows.values() for bar in row.bars)
    start, end = span_of(list(rows.values()), run, pick, start, end)
    for row in rows.values():
        row.lay_out(start, end)
    # The rows of a module come one after the other, and rows without a module last.
    modules = list(dict.fromkeys(module for module, _ in rows if module))
    places = {module: place for place, module in enumerate([*modules, ""])}
    keys = sorted(rows, key=lambda key: (places[key[0]], key == ("", "")))
    shown = (rows[key] for key in keys)
    drawing = Chart(
        start, end, [row for row in shown if any(row.bars) or _shows_empty(row, pick)], list(names)
    )
    drawing.restarts = [one for one in run.restarts if drawing.shows(one.time)]
    return drawing


def _shows_empty(row: ResourceRow, pick: Pick) -> bool:
    """Whether an empty row is shown. A module that only sends must be selected by name."""
    is_wanted = row.has_handlers or pick.modules is not None
    return is_wanted and pick.messages is None and bool(row.connected)


class _RowBuilder:
    """Builds the rows of a chart with their bars."""

    def __init__(self, run: Run, pick: Pick, window: Span) -> None:
        self.run = run
        self.pick = pick
        self.start, self.end = window
        self.rows: dict[tuple[str, str], ResourceRow] = {}

    def build(self) -> dict[tuple[str, str], ResourceRow]:
        """Return the rows, with all bars that are selected and visible."""
        run = self.run
        modules = [module for module in run.modules.values() if self.pick.has_row(module.name)]
        for module in modules:
            self._add_module(module)
        for handling in self._picked(run.handlings):
            self._row(handling.module, handling.resource).handled.append(
                self._handled_bar(handling)
            )
        for module in modules:  # the waits of the module outside of handlers
            waits = self._visible(_lasting(module.waits))
            waits = (wait for wait in waits if self.pick.has_bars(wait.awaited))
            awaited = [self._awaited_bar(module.name, wait) for wait in waits]
            self._row(module.name, _resources(module)[0]).handled += awaited
        for queueing in self._picked(run.queueings):
            self._row(queueing.module, queueing.resource).queued.append(self._queued_bar(queueing))
        for task in run.tasks.values():
            self._add_held(task)
        for claim in chain.from_iterable(run.grants.values()):
            if self.pick.has_row(claim.module):
                self._row(claim.module, claim.resource).claims.append(self._claim_bar(claim))
        return self.rows

    def _add_module(self, module: ModuleRecord) -> None:
        """Add the rows of a module, still without bars."""
        for resource in _resources(module):
            row = self._row(module.name, resource)
            row.connected = [
                (start, self.run.time if end is None else end) for start, end in module.joined
            ]
            row.has_handlers = bool(module.resources)

    def _row(self, module: str, resource: str) -> ResourceRow:
        key = (module, resource)
        if key not in self.rows:
            self.rows[key] = ResourceRow(
                place(*key) if module else resource or NO_HANDLER, is_without_module=not module
            )
        return self.rows[key]

    def _picked(self, spans: Iterable[Any]) -> Iterator[Any]:
        """Yield the selected and visible ones of some handlings or queueings."""
        for span in self._visible(spans):
            if self.pick.has_row(span.module) and self.pick.has_bars(span.message_id):
                yield span

    def _visible(self, spans: Iterable[Any]) -> Iterator[Any]:
        """Yield the spans that overlap the time from start to end."""
        for span in spans:
            if span.start <= self.end and (span.end is None or span.end >= self.start):
                yield span

    # --- single bars ------------------------------------------------------------------------------

    def _bar(
        self, kind: BarKind, name: str, start: float, end: float | None, of: int | None = None
    ) -> Bar:
        """Return a bar *of* a message, without its title."""
        until = self.run.time if end is None else end
        is_unselected = of is not None and not self.pick.is_selected(of)
        return Bar(name, start, until, kind=kind, is_open=end is None, is_unselected=is_unselected)

    def _handled_bar(self, handling: Handling) -> Bar:
        name, number = handling.name, handling.message_id
        bar = self._bar(BarKind.HANDLED, name, handling.start, handling.end, number)
        bar.title = partial(titles.of_handling, self.run, handling)
        if handling.outcome is Outcome.FAILED:
            bar.ending = self._failure_ending(handling)
        elif handling.outcome is Outcome.KILLED:
            bar.ending = Ending.KILLED
        waiter = self.run.describe(number)
        waits = _lasting(handling.waits)
        bar.waits = [self._wait_bar(waiter, name, wait) for wait in waits]
        for part in bar.waits:
            part.end = min(part.end, bar.end)
        bar.marks = self._marks(number, bar)
        task = self.run.tasks.get(number)
        if task is not None and (sent := sent_by_coordinator(self.run, task)) and sent.is_early:
            bar.early_until, bar.is_wasted = sent.entered, sent.is_wasted
        return bar

    def _failure_ending(self, failed: Handling) -> Ending:
        task = self.run.tasks.get(failed.message_id)
        if task and task.state is TaskState.RESOLVED and task.handlings[-1] is failed:
            return Ending.RESOLVED
        return Ending.HANDLED if run_continued_after(self.run, failed) else Ending.FAILED

    def _wait_bar(
        self, waiter: str, name: str, wait: HandlerWait, kind: BarKind = BarKind.WAITING
    ) -> Bar:
        bar = self._bar(kind, name, wait.start, wait.end)
        bar.title = partial(titles.of_wait, self.run, waiter, wait)
        return bar

    def _awaited_bar(self, module: str, wait: HandlerWait) -> Bar:
        name = titles.awaited_name(self.run, wait)
        bar = self._wait_bar(module, name, wait, BarKind.AWAITED)
        bar.waits = [self._wait_bar(module, name, wait)]
        return bar

    def _queued_bar(self, queueing: Queueing) -> Bar:
        number = queueing.message_id
        name = self.run.name(number)
        bar = self._bar(BarKind.QUEUED, name, queueing.start, queueing.end, number)
        bar.title = partial(titles.of_queueing, self.run, queueing)
        bar.marks = self._marks(number, bar)
        return bar

    def _claim_bar(self, claim: Claim) -> Bar:
        kind = BarKind.RESERVED if claim.is_reserved else BarKind.LOCKED
        start = claim.start if claim.granted is None else claim.granted
        bar = self._bar(kind, claim.sender, start, claim.end)
        bar.title = partial(titles.of_claim, self.run, claim, start)
        return bar

    def _marks(self, number: int, bar: Bar) -> list[Mark]:
        """Return the marks of a task's bar: failures raised on it, and requests of its clients.

        The last bar of a task has all later marks, too.
        """
        run, task = self.run, self.run.tasks.get(number)
        failures = run.raised.get(number, ())
        if task is None or not (failures or task.life):
            return []
        marks = []
        for failure in failures:
            ending = Ending.HANDLED if run_continued(run, task, failure.time) else Ending.FAILED
            title = titles.of_failure(run, task, failure)
            marks.append(Mark(failure.time, ending, title))
        changes = (change for change in task.life if change.effect is not Effect.RESULT)
        marks += [Mark(one.time, Ending.NONE, titles.of_change(task, one)) for one in changes]
        starts = [span.start for span in (*task.handlings, *task.queueings)]
        after = min((start for start in starts if start > bar.start), default=inf)
        return [mark for mark in marks if bar.start <= mark.time < after]

    # --- held and suspended tasks -----------------------------------------------------------------

    def _add_held(self, task: Task) -> None:
        """Add the spans in which a task was held or suspended.

        A held task is in the row of its handler, a suspended one in the row of suspended tasks.
        """
        wanted = [TaskState.SUSPENDED]
        if task.id in self.pick.held:
            wanted += _HELD
        spans = [span for span in task.spans() if span[2] in wanted]
        if not spans or not self.pick.has_bars(task.id):
            return
        for start, end, state in spans:
            module, resource = _place_of(self.run, task, start, end)
            if not self.pick.has_row(module):
                continue
            if state is TaskState.SUSPENDED:
                bar = self._task_bar(BarKind.SUSPENDED, task, start, end)
                bar.title = partial(titles.of_suspension, self.run, task, start, bar.ended_at)
                self._row("", SUSPENDED).queued.append(bar)
            else:
                self._row(module, resource).held += self._held_bars(task, start, end)

    def _task_bar(self, kind: BarKind, task: Task, start: float, end: float) -> Bar:
        return self._bar(kind, task.name, start, None if end == inf else end, task.id)

    def _held_bars(self, task: Task, start: float, end: float) -> list[Bar]:
        """Return a bar for each combination of causes, one after the other in a lane."""
        waits = [wait for wait in waits_for_display(self.run, task) if start <= wait.start < end]
        ends = (wait.end for wait in waits if wait.end < end)
        stops = sorted({start, *(wait.start for wait in waits), *ends})
        bars: list[Bar] = []
        for since, until in pairwise([*stops, end]):
            if since > self.end or until < self.start:
                continue
            current = [wait for wait in waits if wait.start <= since < wait.end]
            bar = self._task_bar(BarKind.HELD, task, since, until)
            bar.title = partial(titles.of_hold, self.run, task, since, bar.ended_at, current)
            waiter = "" if bars else f"{task}: "
            bar.why = partial(titles.hold_reason, self.run, waiter, since, current)
            bar.lane_leader = bars[0] if bars else None
            bars.append(bar)
        return bars


def _resources(module: ModuleRecord) -> list[str]:
    """Return a module's resources. The row of the first shows waits outside of handlers."""
    return sorted(module.resources, key=lambda resource: resource not in ("", module.name)) or [""]


def _lasting(waits: Iterable[HandlerWait]) -> Iterator[HandlerWait]:
    """Return the waits that took time; a wait that was over at once is not drawn."""
    return (wait for wait in waits if wait.end is None or wait.end > wait.start)


def _place_of(run: Run, task: Task, start: float, end: float) -> tuple[str, str]:
    """Return the module and resource that handled a task.

    If none did, return a module and resource that could have handled it between *start* and *end*.
    """
    spans: list[Handling | Queueing] = [*task.handlings[:1], *task.queueings]
    for span in spans:
        if span.module:  # not while it waits for a handler
            return span.module, span.resource
    for offer in reversed(run.offers.get(task.name, [])):
        if offer.start < end and (offer.end is None or offer.end > start):
            return offer.module, offer.resource
    return "", ""
