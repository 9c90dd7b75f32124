"""Counts and times of a run, or of a part of it. Percentiles are exact (nearest rank)."""

from collections import defaultdict
from dataclasses import dataclass, field
from math import ceil

from tca_tools.analysis.resources import Key, Use, uses
from tca_tools.analysis.summary import span_of
from tca_tools.journal.records import OVER, Handling, Message, Task, TaskState
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Span, most_at_once
from tca_wire.points import Moment
from tca_wire.vocabulary import MessageClass, Outcome


@dataclass(slots=True)
class Times:
    """Durations in seconds."""

    seconds: list[float] = field(default_factory=list)
    open_times: list[float] = field(default_factory=list)
    """The durations that had not ended, counted until the end of the run."""

    def add(self, start: float, end: float, now: float) -> None:
        """Add the duration from *start* to *end*; until *now* if the end is later."""
        self.seconds.append(min(end, now) - start)
        if end > now:
            self.open_times.append(now - start)

    def is_at_least(self, seconds: float) -> bool:
        """Whether a percentile of *seconds* may grow: an open duration is not longer so far."""
        return any(time <= seconds for time in self.open_times)

    def percentile(self, share: float) -> float | None:
        """Return the percentile *share* (0 to 100) of the sorted durations; None without any."""
        if not self.seconds:
            return None
        return self.seconds[max(ceil(share / 100 * len(self.seconds)), 1) - 1]


@dataclass(slots=True)
class MessageStats:
    """The figures of all messages of one name."""

    message: str
    message_class: str = ""
    sent: int = 0
    handled: int = 0
    """The number of handler runs that have ended."""
    failed_runs: int = 0
    """The number of handler runs that failed, even if the failure was dealt with."""
    failed: int = 0
    """The number of tasks in the state "failed", and of other messages whose last run failed."""
    resolved: int = 0
    """The number of tasks that are done after a failure."""
    killed: int = 0
    """The number of tasks in the state "killed"."""
    dropped: int = 0
    """The number dropped, and for copies the number of receivers that did not get one."""
    open: int = 0
    """The number not answered, achieved or given up at the end."""
    to_start: Times = field(default_factory=Times)
    """From sending to the first start of the handler."""
    handling: Times = field(default_factory=Times)
    """The runs of the handler."""
    to_end: Times = field(default_factory=Times)
    """From sending to the answer, or to the achievement of the task."""
    queued: Times = field(default_factory=Times)
    """The waits for a resource, or for a module that handles it."""

    @property
    def is_of_tasks(self) -> bool:
        """Whether the messages are goals, commands or monitors."""
        return bool(self.message_class) and MessageClass(self.message_class).is_task


@dataclass(slots=True)
class ResourceStats:
    """The figures of a resource; the module "" has the queue of messages without a handler."""

    module: str
    resource: str
    capacity: int = 0
    """The greatest capacity during the run."""
    handled: int = 0
    use: Use | None = None
    """Its use during ``Stats.busy_in``; None if it was not used."""
    queued: Times = field(default_factory=Times)
    longest_queue: int = 0


@dataclass(slots=True)
class Stats:
    """The figures of a run between two times."""

    start: float
    end: float
    is_live: bool
    """Whether the run has not ended."""
    messages: list[MessageStats]
    resources: list[ResourceStats]
    busy_in: Span
    """The span for the use of resources: the measured part of the run.

    For the whole run, it goes from the first task to the end of the last, as in reports.
    """
    deadlocks: int
    """The number of waits that were refused because of a deadlock."""


def measure(run: Run, start: float | None = None) -> Stats:
    """Return the figures of a run, or of its part from *start* on.

    A part has the messages sent since then, and the handler runs started since then.
    """
    start_of_run = run.clock[0] if run.clock else 0.0
    first = start_of_run if start is None else start
    busy_in = span_of(run) if start is None else (first, run.time)
    messages: dict[str, MessageStats] = {}
    resources = _resources(run, busy_in)
    for message in run.messages.values():
        if message.received >= first:
            _count(run, _stats_of(run, messages, message.name), message)
    for handling in run.handlings:
        if handling.start >= first:
            _count_handling(_stats_of(run, messages, handling.name), handling)
            resources[handling.module, handling.resource].handled += 1
    for drop in run.drops:
        if drop.time >= first and drop.is_copy:
            _stats_of(run, messages, drop.name).dropped += 1
    _add_queues(run, messages, resources, first)
    for stats in messages.values():
        for times in (stats.to_start, stats.handling, stats.to_end, stats.queued):
            times.seconds.sort()
    deadlocks = sum(time >= first for time, _ in run.deadlocks)
    found = list(messages.values()), list(resources.values())
    return Stats(first, run.time, run.is_live, *found, busy_in, deadlocks)


def _stats_of(run: Run, messages: dict[str, MessageStats], name: str) -> MessageStats:
    if name not in messages:
        declared = run.formats.get(name)
        kind = str(declared.message_class) if declared else ""
        messages[name] = MessageStats(name, kind)
    return messages[name]


def _count(run: Run, stats: MessageStats, message: Message) -> None:
    stats.message_class = str(message.message_class)
    stats.sent += 1
    stats.dropped += bool(message.dropped)
    if message.handlings:
        stats.to_start.seconds.append(message.handlings[0].start - message.received)
    if isinstance(message, Task):
        state, end = message.state, None
        if state is TaskState.ACHIEVED:
            end = message.time_of(Moment.END_ACHIEVING)
        stats.failed += state is TaskState.FAILED
        stats.resolved += state is TaskState.RESOLVED
        stats.killed += state is TaskState.KILLED
        stats.open += state not in OVER
    else:
        end, has_failed = message.answered, bool(message.failure)
        if message.handlings:
            has_failed = message.handlings[-1].outcome is Outcome.FAILED
        stats.failed += has_failed
        stats.open += end is None and not message.dropped and _is_open(run, message)
    if end is not None:
        stats.to_end.seconds.append(end - message.received)


def _is_open(run: Run, message: Message) -> bool:
    """Whether a message still waits, or its handler has not returned.

    A broadcast or variable is open while one of its copies is. A message that a lost module had
    prefetched has failed without a handler, so it is not open.
    """
    if message.message_class.fans_out and not message.message_class.has_reply:
        handlings = *run.copies.get(message.id, ()), *message.handlings
        return any(handling.end is None for handling in handlings)
    if message.handlings:
        return message.handlings[-1].end is None
    return not message.failure


def _count_handling(stats: MessageStats, handling: Handling) -> None:
    stats.failed_runs += handling.outcome is Outcome.FAILED
    if handling.end is not None:
        stats.handled += 1
        stats.handling.seconds.append(handling.end - handling.start)


def _resources(run: Run, busy_in: Span) -> dict[Key, ResourceStats]:
    """Return all resources, without the figures that depend on single messages."""
    used = {use.key: use for use in uses(run, *busy_in)}
    found: dict[Key, ResourceStats] = {}
    for module in run.modules.values():
        for name, capacity in module.resources.items():
            key, most = (module.name, name), max(capacity, module.capacities.get(name, 0))
            found[key] = ResourceStats(*key, most, use=used.get(key))
    return found


def _add_queues(
    run: Run, messages: dict[str, MessageStats], resources: dict[Key, ResourceStats], first: float
) -> None:
    """Add the waits for resources and handlers."""
    spans: dict[Key, list[Span]] = defaultdict(list)
    for wait in run.queueings:
        if (message := run.messages.get(wait.message_id)) is not None:
            key = (wait.module, wait.resource)
            stats = resources.setdefault(key, ResourceStats(*key))
            spans[key].append((max(wait.start, first), max(wait.until, first)))
            if wait.start >= first:
                stats.queued.add(wait.start, wait.until, run.time)
                of_message = _stats_of(run, messages, message.name)
                of_message.queued.add(wait.start, wait.until, run.time)
    for key, waits in spans.items():
        resources[key].longest_queue = most_at_once(waits)
        resources[key].queued.seconds.sort()
