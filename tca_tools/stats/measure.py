"""Counts and times of a run, or of a part of it. Pure; percentiles are exact (nearest rank)."""

from collections import defaultdict
from dataclasses import dataclass, field
from math import ceil, inf

from tca_tools.analysis.resources import Busy, Key, busy
from tca_tools.analysis.summary import span_of
from tca_tools.run.records import OVER, Handling, Message, State, Task
from tca_tools.run.whole_run import Run
from tca_tools.spans import Span, levels
from tca_wire.points import Moment
from tca_wire.vocabulary import MessageClass, Outcome

_IDLE = Busy(0.0, 0.0, 0.0)


@dataclass(slots=True)
class Times:
    """How long something took, each time, in seconds."""

    seconds: list[float] = field(default_factory=list)
    going_on: list[float] = field(default_factory=list)
    """Those of them that went on at the end, until which they count."""

    def add(self, start: float, end: float | None, now: float) -> None:
        """It began then, and ended or (None) goes on now."""
        self.seconds.append((now if end is None else end) - start)
        if end is None:
            self.going_on.append(now - start)

    def is_at_least(self, seconds: float) -> bool:
        """Whether a percentile that is so long will be longer when all is over."""
        return any(one <= seconds for one in self.going_on)

    def sort(self) -> None:
        """Get ready for being asked."""
        self.seconds.sort()

    def __len__(self) -> int:
        return len(self.seconds)

    @property
    def total(self) -> float:
        """All of it together."""
        return sum(self.seconds)

    def percentile(self, share: float) -> float | None:
        """The least of them that so many percent are no longer than; None if there are none."""
        return self.seconds[max(ceil(share / 100 * len(self.seconds)), 1) - 1] if self.seconds else None


@dataclass(slots=True)
class MessageStats:
    """All messages of one name."""

    name: str
    message_class: str = ""
    sent: int = 0
    """Those that were sent directly are among them."""
    direct: int = 0
    handled: int = 0
    """How often a handler ended."""
    failed_runs: int = 0
    """How often a handler failed, whatever became of that."""
    failed: int = 0
    """How many ended so: a task is then in the state "failed", what is no task was not handled again."""
    killed: int = 0
    """How many tasks are in the state "killed"."""
    dropped: int = 0
    open: int = 0
    """How many were neither answered, achieved nor given up at the end."""
    to_start: Times = field(default_factory=Times)
    """From when it was sent until its handler began first."""
    handling: Times = field(default_factory=Times)
    """Each run of its handler."""
    to_end: Times = field(default_factory=Times)
    """From when it was sent until its sender had the answer, or until it was achieved; nothing of what ended else."""
    queued: Times = field(default_factory=Times)
    """Each wait in a queue, or for a module that handles it."""

    @property
    def is_of_tasks(self) -> bool:
        """Whether these are goals, commands or monitors."""
        return bool(self.message_class) and MessageClass(self.message_class).is_task

    def times(self) -> dict[str, Times]:
        """All that was measured."""
        return {"to_start": self.to_start, "handling": self.handling, "to_end": self.to_end, "queued": self.queued}


@dataclass(slots=True)
class ResourceStats:
    """One resource of a module; the module "" has what nobody handled."""

    module: str
    resource: str
    capacity: int
    """The largest that it had."""
    handled: int = 0
    busy: Busy = _IDLE
    """Between the times of ``Stats.busy_in``."""
    queued: Times = field(default_factory=Times)
    longest_queue: int = 0


@dataclass(slots=True)
class Stats:
    """The figures of a run between two times."""

    start: float
    end: float
    is_live: bool
    """Whether the run goes on after the end."""
    messages: list[MessageStats]
    resources: list[ResourceStats]
    busy_in: Span
    """The times between which it was looked how busy resources were: as in reports, from the first task to the end of
    the last; of a part of the run, that part.
    """
    is_part: bool
    """Whether the start was asked for."""
    deadlocks: int = 0
    """How often somebody was refused to wait, since that would have been a deadlock."""

    @property
    def has_tasks(self) -> bool:
        """Whether any task was sent."""
        return any(stats.is_of_tasks and stats.sent for stats in self.messages)

    @property
    def tasks_in_vain(self) -> int:
        """How many tasks ended otherwise than achieved: how long they took is in no figure."""
        return sum(stats.failed + stats.killed for stats in self.messages if stats.is_of_tasks)

    @property
    def queries_in_vain(self) -> int:
        """The same of queries: how many were dropped, as a rule since their senders gave up."""
        asked = [stats for stats in self.messages if stats.message_class and not stats.is_of_tasks]
        return sum(stats.dropped for stats in asked if MessageClass(stats.message_class).has_reply)

    @property
    def seconds(self) -> float:
        """How long the part of the run is that was looked at."""
        return self.end - self.start


def measure(run: Run, start: float | None = None) -> Stats:
    """The figures from *start* (default: the first entry) on: of the messages sent since then, and of all that ran."""
    first = (run.clock[0] if run.clock else 0.0) if start is None else start
    messages: dict[str, MessageStats] = {}
    for message in run.messages.values():
        if message.received >= first:
            _count(_of(messages, message.name), message)
    _add_handlings(messages, run, first)
    for queueing in run.queueings:
        if queueing.start >= first:
            _of(messages, run.name(queueing.message_id)).queued.add(queueing.start, queueing.end, run.time)
    for stats in messages.values():
        stats.message_class = stats.message_class or _declared_class(run, stats.name)
        for times in stats.times().values():
            times.sort()
    busy_in = span_of(run) if start is None else (first, run.time)
    resources = _resources(run, first, busy_in)
    deadlocks = sum(time >= first for time, _ in run.deadlocks)
    found = list(messages.values())
    return Stats(first, run.time, run.is_live, found, resources, busy_in, start is not None, deadlocks)


def _of(messages: dict[str, MessageStats], name: str) -> MessageStats:
    if name not in messages:
        messages[name] = MessageStats(name)
    return messages[name]


def _declared_class(run: Run, name: str) -> str:
    known = run.formats.get(name)
    return str(known.message_class) if known else ""


def _count(stats: MessageStats, message: Message) -> None:
    stats.message_class = str(message.message_class)
    stats.sent += 1
    stats.dropped += bool(message.dropped)
    if message.handlings:
        stats.to_start.seconds.append(message.handlings[0].start - message.received)
    end = _count_end(stats, message) if isinstance(message, Task) else message.answered
    if end is not None:
        stats.to_end.seconds.append(end - message.received)
    if not isinstance(message, Task):
        stats.failed += any(run.outcome is Outcome.FAILED for run in message.handlings[-1:])
    if end is None and not isinstance(message, Task):
        stats.open += not (message.dropped or any(run.end is not None for run in message.handlings[-1:]))


def _count_end(stats: MessageStats, task: Task) -> float | None:
    """When a task was achieved; None if it was not, or not yet."""
    stats.failed += task.state is State.FAILED
    stats.killed += task.state is State.KILLED
    stats.open += task.state not in OVER
    return task.reached.get(Moment.END_ACHIEVING) if task.state is State.ACHIEVED else None


def _add_handlings(messages: dict[str, MessageStats], run: Run, first: float) -> None:
    for handling in run.handlings:
        if handling.start < first:
            continue
        stats = _of(messages, handling.name)
        stats.failed_runs += handling.outcome is Outcome.FAILED
        if handling.direct_from:
            stats.sent += 1
            stats.direct += 1
            stats.failed += handling.outcome is Outcome.FAILED
        if handling.end is not None:
            stats.handled += 1
            stats.handling.seconds.append(handling.end - handling.start)


def _resources(run: Run, first: float, busy_in: Span) -> list[ResourceStats]:
    found: dict[Key, ResourceStats] = {}
    for module in run.modules.values():
        for resource, capacity in module.resources.items():
            most = max(capacity, module.capacities.get(resource, 0))
            found[module.name, resource] = ResourceStats(module.name, resource, most)
    runs: dict[Key, list[Handling]] = {}
    for handling in run.handlings:
        runs.setdefault((handling.module, handling.resource), []).append(handling)
    for key, handled in runs.items():
        stats = found[key]
        stats.handled = sum(handling.start >= first for handling in handled)
        stats.busy = busy(handled, stats.capacity, *busy_in)
    _add_queues(found, run, first)
    return list(found.values())


def _add_queues(found: dict[Key, ResourceStats], run: Run, first: float) -> None:
    spans: dict[Key, list[Span]] = defaultdict(list)
    for queueing in run.queueings:
        key = (queueing.module, queueing.resource)
        found.setdefault(key, ResourceStats(*key, 0))
        if queueing.end is None or queueing.end >= first:
            spans[key].append((max(queueing.start, first), inf if queueing.end is None else queueing.end))
        if queueing.start >= first:
            found[key].queued.add(queueing.start, queueing.end, run.time)
    for key, some in spans.items():
        found[key].longest_queue = max((number for _, number in levels(some)), default=0)
        found[key].queued.sort()
