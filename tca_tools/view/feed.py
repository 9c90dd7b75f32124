"""The rows from which a page draws any moment of a run by itself: tasks, their states, and spans of
time by resource.

Rows are only ever added, as the history grows, so a page that follows a run is told what is new and
nothing else. What is asked for of one task (its data, its story, why it waits) is not here: see
answers.py.
"""

from enum import StrEnum
from operator import attrgetter

from tca_tools.gantt.build import NO_HANDLER, SUSPENDED
from tca_tools.gantt.looks import dark
from tca_tools.gantt.titles import changed
from tca_tools.journal.coordinators import coordinator_of
from tca_tools.journal.fates import WATCHING, Failing, failing, watches
from tca_tools.journal.fold import History
from tca_tools.journal.records import (
    Claim,
    HandlerWait,
    Handling,
    ModuleRecord,
    Queueing,
    Task,
    TaskState,
)
from tca_tools.spans import Lanes
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
    "entry": "time:d",
    "task": "id:i parent:i name:t sender:t role:t form:t time:d",
    "message": "id:i name:t time:d",  # one that is no task
    "picture": "message:i name:t time:d",  # of the message that gave a variable its value
    "state": "task:i time:d state:t",
    "suspended": "span:i by:t",  # by: " by legs"
    # message: 0 of what came directly; span: the handling that ended with it, or what it was raised
    # beside, or -1
    "failure": "message:i time:d span:i beside:B",
    "verdict": "failure:i good:B time:d",  # whether the run went on after that failure
    "change": "span:i time:d text:t",  # a request of a task's client, or its answer
    "preview": "task:i time:d role:t",  # of a task that a coordinator sent
    "said": "message:i time:d text:t kill:B",  # how it failed, or why it was killed
    "hold": "task:i before:i kind:t time:d",
    "row": "label:t module:t",  # module: "" of what is no module's
    # within: the span in which it lies, or -1; lane: free of others of its kind in its row
    "span": "row:i kind:t name:t message:i within:i lane:i start:d",
    "end": "span:i time:d outcome:t",
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
"""Which spans of a row lie beside each other. What lies within a span, or is behind all, needs no
lane.
"""


_OpenSpan = tuple[int, Lanes | None, int]
"""The number of a span that has not ended, and where it lies."""


class Feed:
    """Columns that grow with a history."""

    def __init__(self) -> None:
        self.history = History()
        self.columns = Columns(TABLES)
        self._add = self.columns.add
        self._rows: dict[str, int] = {}
        self._open: dict[object, _OpenSpan] = {}  # by the identity of a record, or what it is of
        self._newest: dict[
            int, int
        ] = {}  # by message the span in which it was handled or queued last
        self._lanes: dict[tuple[int, str], Lanes] = {}  # by row, and what lies in them
        self._states: dict[
            int, int
        ] = {}  # how many states and constraints of a task have been told
        self._holds: dict[int, int] = {}
        self._watching: set[int] = set()  # the monitors that do
        self._names: dict[str, None] = {}  # of messages, as they came
        self._direct: dict[str, int] = {}  # of those without central, with the row of the first one
        self._ended_badly: list[tuple[Handling, int]] = []  # in the newest entry, with their spans
        self._verdicts = Verdicts(self.history)
        self._traffic = Traffic(self.history, self.columns)

    @property
    def _now(self) -> float:
        return self.history.time

    def colours(self) -> dict[str, str]:
        """The colour of each message, as in other charts of the run: by its place among the
        names.
        """
        direct = sorted(self._direct, key=self._direct.__getitem__)
        names = dict.fromkeys([*self._names, *direct])
        return {name: dark(number) for number, name in enumerate(names)}

    def apply(self, entry: Entry) -> None:
        """Take in what one event caused."""
        history = self.history
        entries = len(history.times)
        history.apply(entry)
        if len(history.times) > entries:
            self._add("entry", history.time)
        news = {id(record): record for record in history.news}.values()
        for task in sorted([record for record in news if type(record) is Task], key=_ID):
            self._tell_task(task)  # a parent before what is under it
        others = [record for record in news if type(record) is not Task]
        for record in sorted(others, key=self._is_new):  # what ends leaves its lane to what begins
            _TELL[type(record)](self, record)
        for fact in entry.facts:
            if tell := _TELL_FACT.get(type(fact)):
                tell(self, fact)
        for run, span in self._ended_badly:  # of which there is no such fact
            self._tell_failure(failing(history, run), (0, run.end or history.time, span, False))
        self._ended_badly.clear()
        for row, is_good in self._verdicts.changed(news):
            self._add("verdict", row, is_good, history.time)

    def _is_new(self, record: object) -> bool:
        return id(record) not in self._open

    # --- facts ------------------------------------------------------------------------------------

    def _tell_received(self, fact: Received) -> None:
        """Add the name of a message, for the search."""
        if (message := self.history.messages.get(fact.id)) is None:
            return
        self._names.setdefault(fact.message)
        self._traffic.tell_message(message)
        if not isinstance(message, Task) and message.received == self._now:
            self._add("message", message.id, message.name, message.received)
            if is_picture(message):
                self._add("picture", message.id, message.name, message.received)

    def _tell_killed(self, fact: Killed) -> None:
        self._tell_said(fact.task, kill_reason(fact.why, fact.by), is_kill=True)

    def _tell_said(self, message: int, text: str, *, is_kill: bool = False) -> None:
        """Add the text of a failure or kill, for the search."""
        self._add("said", message, self._now, text[:_LONGEST_SAID], is_kill)

    def _tell_failed(self, fact: Failed) -> None:
        """A failure was raised on a message, or on what the fact names by its delivery."""
        number = self.history.message_of.get(fact.id, fact.id)
        self._tell_said(number, f"{fact.failure}: {fact.text}")
        failed, span = self.history.messages.get(number), -1
        if fact.is_beside:
            failed, span = self.history.tasks.get(number), self._newest.get(number, -1)
        else:
            for one in self._ended_badly:
                if fact.id in (one[0].delivery, one[0].message_id):
                    self._ended_badly.remove(one)
                    span = one[1]
                    break
        self._tell_failure(failed, (number, self._now, span, fact.is_beside))

    def _tell_changed(self, fact: StateChanged) -> None:
        """Add a mark to the newest bar of a task; not for an intermediate result, of which there
        are many. That of a coordinator tells what other tasks are to it.
        """
        task, span = self.history.tasks.get(fact.task), self._newest.get(fact.task)
        if task is None:
            return
        record = coordinator_of(self.history, task)
        if record is not None and (report := read_report(fact.body)):
            for news in report.news:
                if news.task in record.tasks:
                    self._add("preview", news.task, self._now, news.role)
        if span is None:
            return
        told = (fact.transition, fact.state, fact.serial)
        change = next(one for one in reversed(task.life) if one[1:4] == told)
        if change.effect is not Effect.RESULT:
            self._add("change", span, change.time, changed(task, change))

    def _tell_failure(self, failed: Failing | None, row: tuple[int, float, int, bool]) -> None:
        """Add a failure, with message, time, span, and whether it was raised beside the handler."""
        number = self._add("failure", *row)
        if failed is not None:
            self._verdicts.follow(number, failed, row[1])

    # --- tasks ------------------------------------------------------------------------------------

    def _tell_task(self, task: Task) -> None:
        if (told := self._states.get(task.id, 0)) == 0:
            self._names.setdefault(task.name)
            kind = task.message_class
            form = "monitor" if kind.is_monitor else "goal" if kind.is_goal else ""
            sent = task.sender, task.role, form, task.received
            self._add("task", task.id, task.parent, task.name, *sent)
        is_monitor = task.message_class.is_monitor
        if is_monitor:
            self._tell_watching(task, has_changed=told < len(task.stages))
        for time, state in map(task.stage, range(told, len(task.stages))):
            if not is_monitor:
                self._add("state", task.id, time, state)
            self._tell_suspension(task, state, time)
        self._states[task.id] = len(task.stages)
        if not task.holds:
            return
        for hold in task.holds[self._holds.get(task.id, 0) :]:
            kind_of_hold = kind_of_arrow(hold.constraint)
            self._add("hold", task.id, hold.constraint.before.task, kind_of_hold, hold.added)
        self._holds[task.id] = len(task.holds)

    def _tell_suspension(self, task: Task, state: TaskState, time: float) -> None:
        key = ("suspended", task.id)
        self._end(key, time)
        if state is TaskState.SUSPENDED:
            suspended = [one.by for one in task.suspensions if one.start <= time]
            row = self._row("", SUSPENDED)
            span = self._begin(key, SpanKind.SUSPENDED, row, task.name, task.id, time)
            self._add("suspended", span, by_whom(suspended[-1] if suspended else ""))

    def _tell_watching(self, monitor: Task, *, has_changed: bool) -> None:
        """A monitor watches, and goes on when it does no longer, in one state of its task."""
        state = monitor.stage(-1)[1]
        is_watching = watches(monitor, state)
        if has_changed or is_watching != (monitor.id in self._watching):
            self._add("state", monitor.id, self._now, WATCHING if is_watching else state)
        (self._watching.add if is_watching else self._watching.discard)(monitor.id)

    # --- spans of the chart -----------------------------------------------------------------------

    def _tell_handling(self, record: Handling) -> None:
        row = self._row(record.module, record.resource)
        if not record.message_id:
            self._direct.setdefault(record.name, row)
        if self._is_new(record):
            self._traffic.tell_handling(record)
        about = record.name, record.message_id, record.start
        span = self._begin(id(record), SpanKind.HANDLING, row, *about)
        if record.outcome is Outcome.FAILED and record.end is not None:
            self._ended_badly.append((record, span))
        self._end(id(record), record.end, record.outcome or "")

    def _tell_queueing(self, record: Queueing) -> None:
        row = self._row(record.module, record.resource)
        about = self.history.name(record.message_id), record.message_id, record.start
        self._begin(id(record), SpanKind.QUEUED, row, *about)
        self._end(id(record), record.end)

    def _tell_wait(self, record: HandlerWait) -> None:
        """Add a wait, unless its answer was there at once."""
        if record.end == record.start:
            return
        within = -1
        if isinstance(record.by, Handling):
            row = self._row(record.by.module, record.by.resource)
            if not self._is_new(record.by):
                within = self._open[id(record.by)][0]
        else:
            row = self._row(record.by, "")
        about = self.history.name(record.awaited), record.awaited, record.start
        self._begin(id(record), SpanKind.WAITING, row, *about, within)
        self._end(id(record), record.end)

    def _tell_claim(self, record: Claim) -> None:
        if record.granted is not None and record.granted == self._now:
            row = self._row(record.module, record.resource)
            message = record.by.message_id if record.by else 0
            self._begin(id(record), SpanKind.HELD, row, record.sender, message, record.granted)
        self._end(id(record), record.end)

    def _tell_module(self, record: ModuleRecord) -> None:
        """A module that offers to handle something has rows from the beginning, whether it handles
        anything or not.
        """
        if not record.joined:
            return
        start, end = record.joined[-1]
        if end is not None:
            for resource in record.resources:
                self._end((record.name, resource), end)
            return
        self._row(record.name, "")  # rows stand in the order in which modules joined
        for resource, capacity in record.resources.items():
            if capacity:
                row = self._row(record.name, resource)
                key = (record.name, resource)
                self._begin(key, SpanKind.CONNECTED, row, record.name, 0, start)

    def _row(self, module: str, resource: str) -> int:
        label = place(module, resource) if module else resource or NO_HANDLER
        if (row := self._rows.get(label)) is None:
            row = self._rows[label] = self._add("row", label, module)
        return row

    def _begin(
        self,
        key: object,
        kind: SpanKind,
        row: int,
        name: str,
        message: int,
        start: float,
        within: int = -1,
    ) -> int:
        """Add a span, unless it has begun; its number."""
        if key in self._open:
            return self._open[key][0]
        lanes, lane = None, 0
        if within < 0 and kind in LANES_OF:
            lanes = self._lanes.setdefault((row, LANES_OF[kind]), Lanes())
            lane = lanes.assign(start)
        number = self._add("span", row, kind, name, message, within, lane, start)
        self._open[key] = number, lanes, lane
        if kind in (SpanKind.HANDLING, SpanKind.QUEUED):
            self._newest[message] = number
        return number

    def _end(self, key: object, time: float | None, outcome: str = "") -> None:
        """End a span, if it has begun and *time* says when it ended."""
        if time is not None and key in self._open:
            number, lanes, lane = self._open.pop(key)
            self._add("end", number, time, outcome)
            if lanes is not None:
                lanes.release(lane, time)


_TELL = takers(Feed, parameter="record")
_TELL_FACT = takers(Feed)
