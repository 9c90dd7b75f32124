"""Counts and times of a run, or of a part of it. Pure; percentiles are exact (nearest rank)."""

from collections import defaultdict
from dataclasses import dataclass, field
from math import ceil

from tca_tools.analysis.resources import Key, Use, uses
from tca_tools.analysis.summary import span_of
from tca_tools.journal.records import OVER, Drop, Handling, Message, Task, TaskState
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Span, most_at_once
from tca_wire.points import Moment
from tca_wire.vocabulary import MessageClass, Outcome


@dataclass(slots=True)
class Times:
    """How long something took, each time, in seconds."""

    seconds: list[float] = field(default_factory=list)
    going_on: list[float] = field(default_factory=list)
    """Those of them that went on at the end, until which they count."""

    def add(self, start: float, end: float, now: float) -> None:
        """Add what lasted so long, or goes on *now*."""
        self.seconds.append(min(end, now) - start)
        if end > now:
            self.going_on.append(now - start)

    def is_at_least(self, seconds: float) -> bool:
        """Whether a percentile of this length may grow, because something goes on."""
        return any(one <= seconds for one in self.going_on)

    def percentile(self, share: float) -> float | None:
        """The least of them that so many percent are no longer than; None if there are none. They
        must be sorted.
        """
        if not self.seconds:
            return None
        return self.seconds[max(ceil(share / 100 * len(self.seconds)), 1) - 1]


@dataclass(slots=True)
class MessageStats:
    """All messages of one name."""

    message: str
    message_class: str = ""
    sent: int = 0
    """Those that were sent directly are among them."""
    direct: int = 0
    handled: int = 0
    """How often a handler ended."""
    failed_runs: int = 0
    """How often a handler failed, whatever became of that."""
    failed: int = 0
    """How many ended so: tasks in the state "failed", and others that were not handled again."""
    resolved: int = 0
    """How many tasks are done after a failure."""
    killed: int = 0
    """How many tasks are in the state "killed"."""
    dropped: int = 0
    """How many came to nothing; of what goes to many how often one receiver did not get it, too."""
    open: int = 0
    """How many were neither answered, achieved nor given up at the end."""
    to_start: Times = field(default_factory=Times)
    """From when it was sent until its handler began first."""
    handling: Times = field(default_factory=Times)
    """Each run of its handler."""
    to_end: Times = field(default_factory=Times)
    """From when it was sent until its sender had the answer, or it was achieved."""
    queued: Times = field(default_factory=Times)
    """Each wait for a resource, or for a module that handles it."""

    @property
    def is_of_tasks(self) -> bool:
        """Whether these are goals, commands or monitors."""
        return bool(self.message_class) and MessageClass(self.message_class).is_task


@dataclass(slots=True)
class ResourceStats:
    """One resource of a module; the module "" has what nobody handled."""

    module: str
    resource: str
    capacity: int = 0
    """The largest that it had."""
    handled: int = 0
    use: Use | None = None
    """How busy it was between the times of ``Stats.busy_in``; None if it was not used."""
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
    """The times of the figures of busy resources: as in reports, from the first task to the end of
    the last; of a part of the run, that part.
    """
    deadlocks: int
    """How often somebody was refused to wait, since that would have been a deadlock."""


def measure(run: Run, start: float | None = None) -> Stats:
    """The figures from *start* (default: the first entry) on: of the messages sent since then, and
    of all that ran.
    """
    first = (run.clock[0] if run.clock else 0.0) if start is None else start
    busy_in = span_of(run) if start is None else (first, run.time)
    messages: dict[str, MessageStats] = {}
    resources = _resources(run, busy_in)
    for message in run.messages.values():
        if message.received >= first:
            _count(run, _of(run, messages, message.name), message)
    for handling in run.handlings:
        if handling.start >= first:
            _count_handling(_of(run, messages, handling.name), handling)
            resources[handling.module, handling.resource].handled += 1
    for drop in run.drops:
        if drop.time >= first and drop.name and (drop.is_copy or not drop.message_id):
            _count_drop(_of(run, messages, drop.name), drop)
    _add_queues(run, messages, resources, first)
    for stats in messages.values():
        for times in (stats.to_start, stats.handling, stats.to_end, stats.queued):
            times.seconds.sort()
    deadlocks = sum(time >= first for time, _ in run.deadlocks)
    found = list(messages.values()), list(resources.values())
    return Stats(first, run.time, run.is_live, *found, busy_in, deadlocks)


def _of(run: Run, messages: dict[str, MessageStats], name: str) -> MessageStats:
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
        stats.open += end is None and not message.dropped and _goes_on(run, message)
    if end is not None:
        stats.to_end.seconds.append(end - message.received)


def _count_drop(stats: MessageStats, drop: Drop) -> None:
    """What one receiver did not get of a message, or direct messages, which have no record of their
    own.
    """
    stats.dropped += drop.number
    if not drop.message_id:
        stats.sent += drop.number
        stats.direct += drop.number


def _goes_on(run: Run, message: Message) -> bool:
    """Whether its handler has still to end; of a broadcast or variable that of one of its copies.
    What a lost module had ahead fails without one.
    """
    if message.message_class.fans_out and not message.message_class.has_reply:
        handlings = *run.copies.get(message.id, ()), *message.handlings
        return any(one.end is None for one in handlings)
    if message.handlings:
        return message.handlings[-1].end is None
    return not message.failure


def _count_handling(stats: MessageStats, handling: Handling) -> None:
    has_failed = handling.outcome is Outcome.FAILED
    stats.failed_runs += has_failed
    if handling.direct_from:
        stats.sent += 1
        stats.direct += 1
        stats.failed += has_failed
    if handling.end is not None:
        stats.handled += 1
        stats.handling.seconds.append(handling.end - handling.start)


def _resources(run: Run, busy_in: Span) -> dict[Key, ResourceStats]:
    """All resources, without what depends on single messages."""
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
    """The waits for resources and handlers."""
    spans: dict[Key, list[Span]] = defaultdict(list)
    for wait in run.queueings:
        if (message := run.messages.get(wait.message_id)) is not None:
            key = (wait.module, wait.resource)
            stats = resources.setdefault(key, ResourceStats(*key))
            spans[key].append((max(wait.start, first), max(wait.until, first)))
            if wait.start >= first:
                stats.queued.add(wait.start, wait.until, run.time)
                of_message = _of(run, messages, message.name)
                of_message.queued.add(wait.start, wait.until, run.time)
    for key, some in spans.items():
        resources[key].longest_queue = most_at_once(some)
        resources[key].queued.seconds.sort()
