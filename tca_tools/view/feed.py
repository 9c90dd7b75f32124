"""The rows from which a page draws a run at any time: tasks, their states, spans by resource.

Rows are only added while the history grows, so a page that follows a run receives only new rows.
The details of one task (its data, its story, its waits) are in answers.py.
"""

from enum import StrEnum
from operator import attrgetter

from tca_tools.gantt import titles
from tca_tools.gantt.build import NO_HANDLER, SUSPENDED
from tca_tools.gantt.looks import dark
from tca_tools.journal.coordinators import tasks_of_coordinator
from tca_tools.journal.fates import WATCHING, is_watching
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
from tca_wire.journal.facts import (
    CentralRestarted,
    Entry,
    Failed,
    Killed,
    MembersChanged,
    Received,
    StateChanged,
)
from tca_wire.journal.takers import takers
from tca_wire.life_cycles import Effect
from tca_wire.text.facts_in_words import Wording, by_whom, kill_reason, place
from tca_wire.vocabulary import Outcome

_LONGEST_SAID = 300
_ID = attrgetter("id")
TABLES = {
    "entry": "time:d",
    "task": "id:i parent:i name:t sender:t role:t form:t time:d",
    "message": "id:i name:t time:d",  # a message that is not a task
    "picture": "message:i name:t time:d",  # message: it set the variable
    "state": "task:i time:d state:t",
    "suspended": "span:i by:t",  # by: " by legs"
    # span: the handling that failed or was running, or -1;
    # beside: whether it was raised while the handler ran on
    "failure": "message:i time:d span:i beside:B",
    "verdict": "failure:i good:B time:d",  # good: whether the run continued after that failure
    "change": "span:i time:d text:t",  # a request of a task's client, or its answer
    "preview": "task:i time:d role:t",  # the role of a coordinator's task
    "said": "message:i time:d text:t kill:B",  # the text of its failure, or the reason of its kill
    "hold": "task:i before:i kind:t time:d",
    "restart": "time:d text:t",  # a restart of central
    "members": "time:d text:t standbys:i",  # the centrals with the same replicated log
    "row": "label:t module:t",  # module: "" for a row without a module
    # within: the span that contains it, or -1; lane: no other span of its kind overlaps it there
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
"""The kinds of spans that share lanes in a row. Nested and background spans need no lane."""


_OpenSpan = tuple[int, Lanes | None, int]
"""The number of an open span, its lanes and its lane."""


class Feed:
    """Columns that grow with a history."""

    def __init__(self) -> None:
        self.history = History()
        self.columns = Columns(TABLES)
        self._add = self.columns.add
        self._rows: dict[str, int] = {}
        #: By the identity of a record, or by another key: its open span.
        self._open: dict[object, _OpenSpan] = {}
        #: By message, its last span of handling or queueing.
        self._newest: dict[int, int] = {}
        #: By row and group of kinds: the lanes of the spans.
        self._lanes: dict[tuple[int, str], Lanes] = {}
        #: By task, the numbers of its states and constraints in the columns.
        self._states: dict[int, int] = {}
        self._holds: dict[int, int] = {}
        #: The monitors that watch now.
        self._watching: set[int] = set()
        #: The names of messages, in the order of their arrival.
        self._names: dict[str, None] = {}
        #: The failed handlings of the newest entry, with their spans.
        self._failed_handlings: list[tuple[Handling, int]] = []
        self._verdicts = Verdicts(self.history)
        self._traffic = Traffic(self.history, self.columns)

    @property
    def _now(self) -> float:
        return self.history.time

    def colours(self) -> dict[str, str]:
        """Return the colour of each message, the same as in other charts of the run."""
        return {name: dark(number) for number, name in enumerate(self._names)}

    def apply(self, entry: Entry) -> None:
        """Add the rows of one event."""
        history = self.history
        entries = len(history.times)
        history.apply(entry)
        if len(history.times) > entries:
            self._add("entry", history.time)
        news = {id(record): record for record in history.news}.values()
        for task in sorted([record for record in news if type(record) is Task], key=_ID):
            self._add_task(task)  # a parent before its children
        others = [record for record in news if type(record) is not Task]
        # ended records first: they release their lanes for new ones
        for record in sorted(others, key=self._is_new):
            _ADD_RECORD[type(record)](self, record)
        for fact in entry.facts:
            if add_fact := _ADD_FACT.get(type(fact)):
                add_fact(self, fact)
        self._failed_handlings.clear()
        for failure, is_good in self._verdicts.changed(news):
            self._add("verdict", failure, is_good, history.time)

    def _is_new(self, record: object) -> bool:
        return id(record) not in self._open

    # --- facts ------------------------------------------------------------------------------------

    def _add_received(self, fact: Received) -> None:
        """Add the name of a message, for the search."""
        if (message := self.history.messages.get(fact.id)) is None:
            return
        self._names.setdefault(fact.message)
        self._traffic.add_message(message)
        if not isinstance(message, Task) and message.received == self._now:
            self._add("message", message.id, message.name, message.received)
            if is_picture(message):
                self._add("picture", message.id, message.name, message.received)

    def _add_killed(self, fact: Killed) -> None:
        self._add_text(fact.task, kill_reason(fact.why, fact.by), is_kill=True)

    def _add_text(self, message: int, text: str, *, is_kill: bool = False) -> None:
        """Add the text of a failure or kill, for the search."""
        self._add("said", message, self._now, text[:_LONGEST_SAID], is_kill)

    def _add_failed(self, fact: Failed) -> None:
        """Add a failure of a message, which the fact may name by its delivery."""
        number = self.history.message_of.get(fact.id, fact.id)
        self._add_text(number, f"{fact.failure}: {fact.text}")
        failed, span = self.history.messages.get(number), -1
        if fact.is_beside:
            failed, span = self.history.tasks.get(number), self._newest.get(number, -1)
        else:
            for pair in self._failed_handlings:
                handling, its_span = pair
                if fact.id in (handling.delivery, handling.message_id):
                    self._failed_handlings.remove(pair)
                    span = its_span
                    break
        row = self._add("failure", number, self._now, span, fact.is_beside)
        if failed is not None:
            self._verdicts.follow(row, failed, self._now)

    def _add_changed(self, fact: StateChanged) -> None:
        """Add a mark to the newest bar of a task, and the new roles of a coordinator's tasks.

        Intermediate results have no marks: they are too many.
        """
        task, span = self.history.tasks.get(fact.task), self._newest.get(fact.task)
        if task is None:
            return
        sent = tasks_of_coordinator(self.history, task)
        if sent is not None and (report := read_report(fact.body)):
            for news in report.news:
                if news.task in sent.tasks:
                    self._add("preview", news.task, self._now, news.role)
        if span is None:
            return
        wanted = (fact.transition, fact.state, fact.serial)
        change = next(one for one in reversed(task.life) if one[1:4] == wanted)
        if change.effect is not Effect.RESULT:
            self._add("change", span, change.time, titles.of_change(task, change))

    def _add_restarted(self, fact: CentralRestarted) -> None:  # noqa: ARG002 - names the fact
        restart = self.history.restarts[-1]
        self._add("restart", restart.time, str(restart))

    def _add_members(self, fact: MembersChanged) -> None:
        text = Wording().words(fact)
        self._add("members", self._now, text, len(fact.standbys) - len(fact.behind))

    # --- tasks ------------------------------------------------------------------------------------

    def _add_task(self, task: Task) -> None:
        if (known := self._states.get(task.id, 0)) == 0:
            self._names.setdefault(task.name)
            kind = task.message_class
            form = "goal" if kind.is_goal else ""
            if kind.is_monitor:
                form = "monitor"
            sent = task.sender, task.role, form, task.received
            self._add("task", task.id, task.parent, task.name, *sent)
        is_monitor = task.message_class.is_monitor
        if is_monitor:
            self._add_watching(task, has_changed=known < len(task.stages))
        for time, state in map(task.stage, range(known, len(task.stages))):
            if not is_monitor:
                self._add("state", task.id, time, state)
            self._add_suspension(task, state, time)
        self._states[task.id] = len(task.stages)
        if not task.holds:
            return
        for hold in task.holds[self._holds.get(task.id, 0) :]:
            kind_of_hold = kind_of_arrow(hold.constraint)
            self._add("hold", task.id, hold.constraint.before.task, kind_of_hold, hold.added)
        self._holds[task.id] = len(task.holds)

    def _add_suspension(self, task: Task, state: TaskState, time: float) -> None:
        key = ("suspended", task.id)
        self._close_span(key, time)
        if state is TaskState.SUSPENDED:
            suspended = [one.by for one in task.suspensions if one.start <= time]
            row = self._row("", SUSPENDED)
            span = self._open_span(key, SpanKind.SUSPENDED, row, task.name, task.id, time)
            self._add("suspended", span, by_whom(suspended[-1] if suspended else ""))

    def _add_watching(self, monitor: Task, *, has_changed: bool) -> None:
        """Add the state "watching" of a monitor, which the state of its task does not show."""
        state = monitor.stage(-1)[1]
        watching = is_watching(monitor, state)
        if has_changed or watching != (monitor.id in self._watching):
            self._add("state", monitor.id, self._now, WATCHING if watching else state)
        (self._watching.add if watching else self._watching.discard)(monitor.id)

    # --- spans of the chart -----------------------------------------------------------------------

    def _add_handling(self, record: Handling) -> None:
        row = self._row(record.module, record.resource)
        if self._is_new(record):
            self._traffic.add_handling(record)
        about = record.name, record.message_id, record.start
        span = self._open_span(id(record), SpanKind.HANDLING, row, *about)
        if record.outcome is Outcome.FAILED and record.end is not None:
            self._failed_handlings.append((record, span))
        self._close_span(id(record), record.end, record.outcome or "")

    def _add_queueing(self, record: Queueing) -> None:
        row = self._row(record.module, record.resource)
        about = self.history.name(record.message_id), record.message_id, record.start
        self._open_span(id(record), SpanKind.QUEUED, row, *about)
        self._close_span(id(record), record.end)

    def _add_wait(self, record: HandlerWait) -> None:
        """Add a wait, unless its answer arrived at once."""
        if record.end == record.start:
            return
        within = -1
        if isinstance(record.by, Handling):
            row = self._row(record.by.module, record.by.resource)
            if not self._is_new(record.by):
                within = self._open[id(record.by)][0]
        else:
            row = self._row(record.by, "")
        message = 0 if record.awaited in self.history.claims else record.awaited
        about = titles.awaited_name(self.history, record), message, record.start
        self._open_span(id(record), SpanKind.WAITING, row, *about, within)
        self._close_span(id(record), record.end)

    def _add_claim(self, record: Claim) -> None:
        if record.granted is not None and record.granted == self._now:
            row = self._row(record.module, record.resource)
            message = record.by.message_id if record.by else 0
            self._open_span(id(record), SpanKind.HELD, row, record.sender, message, record.granted)
        self._close_span(id(record), record.end)

    def _add_module(self, record: ModuleRecord) -> None:
        """Add the rows of a module with handlers when it joins, before it handles anything."""
        if not record.joined:
            return
        start, end = record.joined[-1]
        if end is not None:
            for resource in record.resources:
                self._close_span((record.name, resource), end)
            return
        self._row(record.name, "")  # rows are in the order in which modules joined
        for resource, capacity in record.resources.items():
            if capacity:
                row = self._row(record.name, resource)
                key = (record.name, resource)
                self._open_span(key, SpanKind.CONNECTED, row, record.name, 0, start)

    def _row(self, module: str, resource: str) -> int:
        label = place(module, resource) if module else resource or NO_HANDLER
        if (row := self._rows.get(label)) is None:
            row = self._rows[label] = self._add("row", label, module)
        return row

    def _open_span(
        self,
        key: object,
        kind: SpanKind,
        row: int,
        name: str,
        message: int,
        start: float,
        within: int = -1,
    ) -> int:
        """Add a span, unless it is open already. Return its number."""
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

    def _close_span(self, key: object, time: float | None, outcome: str = "") -> None:
        """Close a span, if it is open and *time* is known."""
        if time is not None and key in self._open:
            number, lanes, lane = self._open.pop(key)
            self._add("end", number, time, outcome)
            if lanes is not None:
                lanes.release(lane, time)


_ADD_RECORD = takers(Feed, parameter="record")
_ADD_FACT = takers(Feed)
