"""All records of a run. fold.py fills them; at_time.py reads what was known at an instant."""

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

from tca_tools.journal.failure import NO_FAILURE, Failure
from tca_tools.journal.records import (
    Claim,
    Drop,
    Exhausted,
    HandlerWait,
    Handling,
    Message,
    ModuleRecord,
    Offer,
    PlannedEvent,
    Queueing,
    Raised,
    Restart,
    Suspension,
    Task,
)
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.text.facts_in_words import called

UNKNOWN = "?"
"""The name of messages sent before the journal's first entry."""


class Reactions:
    """The records of failures, wiretaps, monitors and deadlines, apart from those in tasks."""

    def __init__(self) -> None:
        self.taps: dict[int, facts.TapAdded] = {}
        self.attached: dict[int, facts.Attached] = {}
        self.reissued: dict[int, float] = {}
        """By exception handler that passed its failure on: the time."""
        self.left_open: dict[int, float] = {}
        """By exception handler that returned without a decision: the time."""
        self.unhandled: dict[int, list[float]] = {}
        """For each task, the times of its failures that were not handled."""
        self.exhausted: dict[int, list[Exhausted]] = {}
        """For each task with an unhandled failure, the exception handlers with no calls left."""
        self.plans: dict[int, list[PlannedEvent]] = {}
        """For each task, its planned kills and deadlines."""
        self.tests: dict[int, list[tuple[float, bool]]] = {}
        """For each monitor, the times of its tests and whether the condition held."""
        self.conditions: dict[int, Message] = {}
        """For each monitor, the first query for its condition."""
        self.asked_by: list[Handling | str] = []
        """The origin of each entry: the run of a handler, or a module outside of handlers; "" for
        central's own entries.
        """
        self.raised: dict[int, list[Raised]] = {}
        """For each task, the failures raised beside its handler."""
        self.deadlocks: dict[tuple[float, str], Failure] = {}
        """Waits refused as deadlocks, by time and module; the words describe the cycle."""


class Run(Reactions):
    """The run as known until ``time``.

    1. ``tasks`` holds every task, ``messages`` every message, tasks included, oldest first.
    2. A task's parent is the root or a task with a smaller id, so walks up and down end.
    """

    until_time: float | None = None
    """The time until which the journal was read, if it has later entries."""

    epoch = ""

    is_live = False
    """Whether the run is live: then ``time`` is the present, and open records may still end."""

    def __init__(self) -> None:
        super().__init__()
        self.time = 0.0
        self.times, self.clock, self.numbers = array("d"), array("d"), array("q")
        """For each entry its unique, increasing time, its time as written, and its number."""
        self.began: float | None = None
        """Wall-clock time (seconds since 1970) at which ``time`` was 0."""
        self.top: list[TaskId] = []
        """The top-level tasks."""
        self.tasks: dict[int, Task] = {}
        self.births = array("d")
        """When each task was sent."""
        self.messages: dict[int, Message] = {}
        self.message_of: dict[int, int] = {}
        """By delivery: its message. Only deliveries whose number is not that of their message are
        listed: those of a retry, and those to one of many receivers.
        """
        self.handlings: list[Handling] = []
        self.queueings: list[Queueing] = []
        self.copies: dict[int, list[Queueing]] = {}
        """For each message to many receivers, the waits of its copies in queues."""
        self.drops: list[Drop] = []
        self.restarts: list[Restart] = []
        self.modules: dict[str, ModuleRecord] = {}
        self.claims: dict[int, Claim] = {}
        """Locks and reservations."""
        self.grants: dict[tuple[str, str], list[Claim]] = {}
        """The granted locks and reservations in their order, by the module's own name and resource.
        """
        self.requested: dict[tuple[str, str], list[Claim]] = {}
        """All requested locks and reservations in their order, by the same keys."""
        self.by_resource: dict[tuple[str, str], list[Handling]] = {}
        """By module and resource: the handlings of deliveries, in the order of their starts."""
        self.offers: dict[str, list[Offer]] = {}
        """For each message, the modules' offers to handle it, oldest first."""
        self.formats: dict[str, facts.FormatDefined] = {}
        """For each message, its class and formats as first declared."""
        self.memo: dict[object, Any] = {}
        """Results that other modules cache here; each checks whether its results are stale."""

    def asker_at(self, time: float) -> Handling | str:
        """Return the origin of the entry at a time; "" for central's own entries."""
        place = bisect_left(self.times, time)
        return self.asked_by[place] if place < len(self.times) and self.times[place] == time else ""

    def suspensions(self) -> Iterator[Suspension]:
        """Yield the suspensions of tasks that were suspended directly."""
        for task in self.tasks.values():
            yield from (one for one in task.suspensions if one.cause == task.id)

    def under(self, task: Task) -> Iterator[Task]:
        """Yield a task and its descendants."""
        below = [task]
        for one in below:  # the list grows during the loop
            yield one
            below += [self.tasks[child] for child in one.children]

    def children_until(self, children: Sequence[TaskId], time: float) -> Sequence[TaskId]:
        """Return the tasks of a list, sorted oldest first, that had been sent at *time*."""
        if time >= self.time:
            return children
        return children[: bisect_right(children, time, key=self.sent_at)]

    def sent_at(self, task: int) -> float:
        """Return when a task was sent; -inf if it is unknown, so sent before the journal began."""
        return self.tasks[task].received if task in self.tasks else -inf

    def granted(self, module: str, resource: str) -> list[Claim]:
        """Return the granted locks and reservations of a resource, in all copies of its module."""
        return self.grants.get((called(module), resource), [])

    def requested_claims(self, module: str, resource: str) -> list[Claim]:
        """Return the requested locks and reservations of a resource, in all module copies."""
        return self.requested.get((called(module), resource), [])

    def deadlock(self, wait: HandlerWait) -> Failure:
        """Return the deadlock that ended a wait; an empty failure if none did."""
        if wait.end is None or not self.deadlocks:
            return NO_FAILURE
        by = wait.by if isinstance(wait.by, str) else wait.by.module
        return self.deadlocks.get((wait.end, by), NO_FAILURE)

    def describe(self, message_id: int) -> str:
        """Return a message's name with its id: ``take steps {7}``."""
        return f"{self.name(message_id)} {{{message_id}}}"

    def name(self, number: int) -> str:
        """Return the name of a message, of a delivery's message, or of a lock or reservation."""
        found = self.messages.get(number) or self.delivered(number) or self.claims.get(number)
        return found.name if found else UNKNOWN

    def delivered(self, delivery: int) -> Message | None:
        """Return the message of a delivery."""
        return self.messages.get(self.message_of.get(delivery, delivery))

    def entries_until(self, clock: float) -> int:
        """Return the number of entries up to *clock*."""
        return bisect_right(self.clock, clock)
