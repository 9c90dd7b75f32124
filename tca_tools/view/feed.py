"""The rows from which a page draws any moment of a run by itself: tasks, their states, and spans of time by resource.

Rows are only ever added, as the history grows, so a page that follows a run is told what is new and nothing else. What
is asked for of one task (its data, its story, why it waits) is not here: see answers.py.
"""

from enum import StrEnum
from heapq import heapify, heappop, heappush
from operator import attrgetter

from tca_tools.gantt.build import NO_HANDLER, SUSPENDED
from tca_tools.gantt.looks import dark
from tca_tools.gantt.titles import changed
from tca_tools.journal.coordinators import coordinator_of
from tca_tools.journal.fates import WATCHING, Failing, failing, watches
from tca_tools.journal.fold import History
from tca_tools.journal.records import Claim, HandlerWait, Handling, ModuleRecord, Queueing, Task, TaskState
from tca_tools.tasktree_viz.arrows import kind_of_arrow
from tca_tools.view.columns import Columns
from tca_tools.view.pictures import is_picture
from tca_tools.view.traffic import TRAFFIC_TABLES, Traffic
from tca_tools.view.verdicts import Verdicts
from tca_wire.coordination import read_report
from tca_wire.journal.facts import Entry, Failed, Killed, Received, StateChanged
from tca_wire.journal.takers import takers
from tca_wire.life_cycles import Effect
from tca_wire.text.facts_in_words import by_whom, kill_reason, place
from tca_wire.vocabulary import Outcome

_LONGEST_SAID = 300
_ID = attrgetter("id")
TABLES = {
    "entry.time": "d",
    "task.id": "i",
    "task.parent": "i",
    "task.name": "t",
    "task.sender": "t",
    "task.role": "t",
    "task.form": "t",
    "task.time": "d",
    "message.id": "i",  # of one that is no task
    "message.name": "t",
    "message.time": "d",
    "picture.message": "i",  # that gave a variable its value
    "picture.name": "t",
    "picture.time": "d",
    "state.task": "i",  # a task's id
    "state.time": "d",
    "state.state": "t",
    "suspended.span": "i",
    "suspended.by": "t",  # " by legs"
    "failure.message": "i",  # or 0: of what came directly
    "failure.time": "d",
    "failure.span": "i",  # the run of a handler that ended with it, or what it was raised beside; or -1
    "failure.beside": "B",  # whether it was raised beside the handler
    "verdict.failure": "i",  # the row of a failure
    "verdict.good": "B",  # whether the run went on after it, from then on
    "verdict.time": "d",
    "change.span": "i",  # a request of a task's client, or its answer
    "change.time": "d",
    "change.text": "t",
    "preview.task": "i",  # one that a coordinator sent
    "preview.time": "d",
    "preview.role": "t",
    "said.message": "i",
    "said.time": "d",
    "said.text": "t",  # how it failed, or why it was killed
    "said.kill": "B",  # whether it is the latter
    "hold.task": "i",
    "hold.before": "i",
    "hold.kind": "t",
    "hold.time": "d",
    "row.label": "t",
    "row.module": "t",  # "" of what is no module's
    "span.row": "i",
    "span.kind": "t",
    "span.name": "t",
    "span.message": "i",
    "span.within": "i",  # the span in which it lies, or -1
    "span.lane": "i",  # among those of its kind in its row nothing else has this number meanwhile
    "span.start": "d",
    "end.span": "i",
    "end.time": "d",
    "end.outcome": "t",
    **TRAFFIC_TABLES,
}
"""A frame's columns with their kinds (see columns.py)."""


class SpanKind(StrEnum):
    """The kind of a span of time."""

    HANDLING = "handling"
    QUEUED = "queued"
    WAITING = "waiting"  # within a handling, or of a module outside of handlers
    HELD = "held"  # a resource is locked or reserved
    CONNECTED = "connected"
    SUSPENDED = "suspended"


LANES_OF = {
    SpanKind.HANDLING: "handled",
    SpanKind.QUEUED: "queued",
    SpanKind.WAITING: "handled",
    SpanKind.HELD: "held",
    SpanKind.SUSPENDED: "queued",
}
"""Which spans of a row lie beside each other. What lies within a span, or is behind all, needs no lane."""


class Lanes:
    """Lanes, in each of which nothing overlaps. What begins gets the first that is free."""

    def __init__(self) -> None:
        self._ends: list[float] = []
        """When what was last in each of them ended."""
        self._free: list[int] = []

    def take(self, start: float) -> int:
        """A lane for what begins at that time."""
        if self._free and self._ends[self._free[0]] <= start:
            return heappop(self._free)
        for lane in sorted(self._free):  # what is told late began before others ended
            if self._ends[lane] <= start:
                self._free.remove(lane)
                heapify(self._free)
                return lane
        self._ends.append(start)
        return len(self._ends) - 1

    def leave(self, lane: int, end: float) -> None:
        """Free the lane when its span has ended."""
        self._ends[lane] = end
        heappush(self._free, lane)


class Feed:
    """Columns that grow with a history."""

    def __init__(self) -> None:
        self.history = History()
        self.columns = Columns(TABLES)
        self._rows: dict[str, int] = {}
        self._open: dict[int, int] = {}  # the spans of records that go on, by the records' identity
        self._newest: dict[int, int] = {}  # by message the span in which it was handled or queued last
        self._connected: dict[str, dict[str, int]] = {}  # the spans of modules that are connected, by resource
        self._lanes: dict[tuple[int, str], Lanes] = {}  # by row, and what lies in them
        self._in_lane: dict[int, tuple[Lanes, int]] = {}  # where spans are that have not ended
        self._suspended: dict[int, int] = {}  # the spans of tasks that are
        self._states: dict[int, int] = {}  # how many states and constraints of a task have been told
        self._holds: dict[int, int] = {}
        self._watching: set[int] = set()  # the monitors that do
        self._names: dict[str, None] = {}  # of messages, as they came
        self._direct: dict[str, int] = {}  # of those that came without central, with the row of the first one
        self._ended_badly: list[tuple[Handling, int]] = []  # with the newest entry: runs of handlers with their spans
        self._verdicts = Verdicts(self.history)
        self._traffic = Traffic(self.history, self.columns)

    def colours(self) -> dict[str, str]:
        """The colour of each message, as in other charts of the run: by its place among the names."""
        direct = sorted(self._direct, key=self._direct.__getitem__)
        return {name: dark(number) for number, name in enumerate(dict.fromkeys([*self._names, *direct]))}

    def apply(self, entry: Entry) -> None:
        """Take in what one event caused."""
        history, columns = self.history, self.columns
        entries = len(history.times)
        history.apply(entry)
        if len(history.times) > entries:
            columns.add("entry", history.time)
        news = {id(record): record for record in history.news}.values()
        for task in sorted([record for record in news if type(record) is Task], key=_ID):
            self._tell_task(task)  # a parent before what is under it
        others = [record for record in news if type(record) is not Task]
        ending = [record for record in others if id(record) in self._open]
        beginning = [record for record in others if id(record) not in self._open]
        for record in [*ending, *beginning]:  # what ends leaves its lane to what begins
            _TELL[type(record)](self, record)
        for fact in entry.facts:
            if tell := _TELL_FACT.get(type(fact)):
                tell(self, fact)
        for run, span in self._ended_badly:  # of which there is no such fact
            self._tell_failure(failing(self.history, run), 0, history.time if run.end is None else run.end, span)
        self._ended_badly.clear()
        for row, is_good in self._verdicts.changed(news):
            columns.add("verdict", row, is_good, history.time)

    def _tell_received(self, fact: Received) -> None:
        """Add the name of a message, for the search."""
        if (message := self.history.messages.get(fact.id)) is None:
            return
        self._names.setdefault(fact.message)
        self._traffic.tell_message(message)
        if not isinstance(message, Task) and message.received == self.history.time:
            self.columns.add("message", message.id, message.name, message.received)
            if is_picture(message):
                self.columns.add("picture", message.id, message.name, message.received)

    def _tell_killed(self, fact: Killed) -> None:
        self._tell_said(fact.task, kill_reason(fact.why, fact.by), is_kill=True)

    def _tell_said(self, message: int, text: str, *, is_kill: bool = False) -> None:
        """Add the text of a failure or kill, for the search."""
        self.columns.add("said", message, self.history.time, text[:_LONGEST_SAID], is_kill)

    def _tell_failed(self, fact: Failed) -> None:
        """A failure was raised on a message, or on what the fact names by its delivery."""
        number = self.history.message_of.get(fact.id, fact.id)
        self._tell_said(number, f"{fact.failure}: {fact.text}")
        if fact.is_beside:
            span = self._newest.get(number, -1)
            self._tell_failure(self.history.tasks.get(number), number, self.history.time, span, is_beside=True)
            return
        runs = [one for one in self._ended_badly if fact.id in (one[0].delivery, one[0].message_id)][:1]
        for one in runs:
            self._ended_badly.remove(one)
        self._tell_failure(self.history.messages.get(number), number, self.history.time, runs[0][1] if runs else -1)

    def _tell_changed(self, fact: StateChanged) -> None:
        """Add a mark to the newest bar of a task; not for an intermediate result, of which there are many. That of a
        coordinator tells what other tasks are to it.
        """
        task, span = self.history.tasks.get(fact.task), self._newest.get(fact.task)
        record = coordinator_of(self.history, task) if task is not None else None
        if record is not None and (report := read_report(fact.body)):
            for news in report.news:
                if news.task in record.tasks:
                    self.columns.add("preview", news.task, self.history.time, news.role)
        if task is None or span is None:
            return
        change = next(one for one in reversed(task.life) if one[1:4] == (fact.transition, fact.state, fact.serial))
        if change.effect is not Effect.RESULT:
            self.columns.add("change", span, change.time, changed(task, change))

    def _tell_failure(
        self, failed: Failing | None, message: int, time: float, span: int, is_beside: bool = False
    ) -> None:
        row = self.columns.add("failure", message, time, span, is_beside)
        if failed is not None:
            self._verdicts.follow(row, failed, time)

    def _tell_task(self, task: Task) -> None:
        if (told := self._states.get(task.id, 0)) == 0:
            self._names.setdefault(task.name)
            form = "monitor" if task.message_class.is_monitor else "goal" if task.message_class.is_goal else ""
            self.columns.add("task", task.id, task.parent, task.name, task.sender, task.role, form, task.received)
        is_monitor = task.message_class.is_monitor
        if is_monitor:
            self._tell_watching(task, has_changed=told < len(task.stages))
        for time, state in map(task.stage, range(told, len(task.stages))):
            if not is_monitor:
                self.columns.add("state", task.id, time, state)
            self._tell_suspension(task, state, time)
        self._states[task.id] = len(task.stages)
        if not task.holds:
            return
        for hold in task.holds[self._holds.get(task.id, 0) :]:
            self.columns.add("hold", task.id, hold.constraint.before.task, kind_of_arrow(hold.constraint), hold.added)
        self._holds[task.id] = len(task.holds)

    def _tell_suspension(self, task: Task, state: TaskState, time: float) -> None:
        if (span := self._suspended.pop(task.id, None)) is not None:
            self._end_span(span, time)
        if state is TaskState.SUSPENDED:
            by = next((one.by for one in reversed(task.suspensions) if one.start <= time), "")
            span = self._suspended[task.id] = self._add_span(
                self._row("", SUSPENDED), SpanKind.SUSPENDED, task.name, task.id, time
            )
            self.columns.add("suspended", span, by_whom(by))

    def _tell_watching(self, monitor: Task, *, has_changed: bool) -> None:
        """A monitor watches, and goes on when it does no longer, in one state of its task."""
        state = monitor.stage(-1)[1]
        is_watching = watches(monitor, state)
        if has_changed or is_watching != (monitor.id in self._watching):
            self.columns.add("state", monitor.id, self.history.time, WATCHING if is_watching else state)
        (self._watching.add if is_watching else self._watching.discard)(monitor.id)

    def _tell_handling(self, record: Handling) -> None:
        row = self._row(record.module, record.resource)
        if not record.message_id:
            self._direct.setdefault(record.name, row)
        if id(record) not in self._open:
            self._traffic.tell_handling(record)
        self._span(record, SpanKind.HANDLING, row, record.name, record.message_id, record.start)
        if record.end is not None:
            if record.outcome is Outcome.FAILED:
                self._ended_badly.append((record, self._open[id(record)]))
            self._end(record, record.end, record.outcome or "")

    def _tell_queueing(self, record: Queueing) -> None:
        row = self._row(record.module, record.resource)
        name = self.history.name(record.message_id)
        self._span(record, SpanKind.QUEUED, row, name, record.message_id, record.start)
        if record.end is not None:
            self._end(record, record.end)

    def _tell_wait(self, record: HandlerWait) -> None:
        """Add a wait, unless its answer was there at once."""
        if record.end == record.start:
            return
        name = self.history.name(record.awaited)
        if isinstance(record.by, Handling):
            row, within = self._row(record.by.module, record.by.resource), self._open.get(id(record.by), -1)
        else:
            row, within = self._row(record.by, ""), -1
        self._span(record, SpanKind.WAITING, row, name, record.awaited, record.start, within)
        if record.end is not None:
            self._end(record, record.end)

    def _tell_claim(self, record: Claim) -> None:
        if record.granted is not None and record.granted == self.history.time:
            row = self._row(record.module, record.resource)
            message = record.by.message_id if record.by else 0
            self._span(record, SpanKind.HELD, row, record.sender, message, record.granted)
        if record.end is not None and id(record) in self._open:
            self._end(record, record.end)

    def _tell_module(self, record: ModuleRecord) -> None:
        """A module that offers to handle something has rows from the beginning, whether it handles anything or not."""
        if not record.joined:
            return
        start, end = record.joined[-1]
        connected = self._connected.setdefault(record.name, {})
        if end is not None:
            for span in connected.values():
                self._end_span(span, end)
            connected.clear()
            return
        self._row(record.name, "")  # rows stand in the order in which modules joined
        for resource, capacity in record.resources.items():
            if capacity and resource not in connected:
                row = self._row(record.name, resource)
                connected[resource] = self._add_span(row, SpanKind.CONNECTED, record.name, 0, start)

    def _row(self, module: str, resource: str) -> int:
        label = place(module, resource) if module else resource or NO_HANDLER
        if (row := self._rows.get(label)) is None:
            row = self._rows[label] = self.columns.add("row", label, module)
        return row

    def _span(
        self, record: object, kind: SpanKind, row: int, name: str, message: int, start: float, within: int = -1
    ) -> None:
        """Tell of a record that is new."""
        if id(record) not in self._open:
            self._open[id(record)] = number = self._add_span(row, kind, name, message, start, within)
            if kind in (SpanKind.HANDLING, SpanKind.QUEUED):
                self._newest[message] = number

    def _add_span(self, row: int, kind: SpanKind, name: str, message: int, start: float, within: int = -1) -> int:
        lane, lanes = 0, None
        if within < 0 and kind in LANES_OF:
            lanes = self._lanes.setdefault((row, LANES_OF[kind]), Lanes())
            lane = lanes.take(start)
        number = self.columns.add("span", row, kind, name, message, within, lane, start)
        if lanes is not None:
            self._in_lane[number] = lanes, lane
        return number

    def _end(self, record: object, time: float, outcome: str = "") -> None:
        self._end_span(self._open.pop(id(record)), time, outcome)

    def _end_span(self, span: int, time: float, outcome: str = "") -> None:
        self.columns.add("end", span, time, outcome)
        if span in self._in_lane:
            lanes, lane = self._in_lane.pop(span)
            lanes.leave(lane, time)


_TELL = takers(Feed, parameter="record")
_TELL_FACT = takers(Feed)
