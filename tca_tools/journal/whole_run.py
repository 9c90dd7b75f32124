"""All records of a run, as far as they are known. fold.py fills it; at_time.py asks it what was
known when.
"""

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

from tca_tools.journal.records import (
    NO_FAILURE,
    Claim,
    Drop,
    EventAhead,
    Exhausted,
    Failure,
    HandlerWait,
    Handling,
    Message,
    ModuleRecord,
    Offer,
    Queueing,
    Raised,
    Suspension,
    Task,
)
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.text.facts_in_words import called

UNKNOWN = "?"
"""The name of what was sent before the journal's first entry."""


class Reactions:
    """The failures, wiretaps, monitors and deadlines known beside the tasks themselves."""

    def __init__(self) -> None:
        self.taps: dict[int, facts.TapAdded] = {}
        self.attached: dict[int, facts.Attached] = {}
        self.reissued: dict[int, float] = {}
        """When which exception handlers passed their failure on."""
        self.left_open: dict[int, float] = {}
        """When which exception handlers returned without dealing with their failure."""
        self.unhandled: dict[int, list[float]] = {}
        """For tasks whose failure was not handled when that was so."""
        self.exhausted: dict[int, list[Exhausted]] = {}
        """For tasks whose failure was not handled the exception handlers that might not be called
        once more.
        """
        self.ahead: dict[int, list[EventAhead]] = {}
        """For tasks that are to be killed, or must be done by a time: that."""
        self.tests: dict[int, list[tuple[float, bool]]] = {}
        """For each monitor when its condition was tested, and whether it held."""
        self.conditions: dict[int, Message] = {}
        """For each monitor the first query that asked for its condition."""
        self.asked_by: list[Handling | str] = []
        """The origin of each entry: the run of a handler, or a module outside of handlers; "" if
        nobody asked.
        """
        self.raised: dict[int, list[Raised]] = {}
        """By task the failures that were raised beside its handler."""
        self.deadlocks: dict[tuple[float, str], Failure] = {}
        """When which module was refused to wait, since that would have been a deadlock: "deadlock",
        and the circle.
        """


class Run(Reactions):
    """The run as known until ``time``.

    1. ``tasks`` holds every task, ``messages`` every message, tasks included, oldest first.
    2. A task's parent is the root or a task with a smaller id, so walks up and down end.
    """

    until_time: float | None = None
    """Until when the journal was read, if it goes on after that."""

    epoch = ""

    is_live = False
    """Whether the run goes on: ``time`` is then the present, and what has not ended may still."""

    def __init__(self) -> None:
        super().__init__()
        self.time = 0.0
        self.times, self.clock, self.numbers = array("d"), array("d"), array("q")
        """The time of each entry, each later than the one before; what it says that its time is;
        and its number.
        """
        self.began: float | None = None
        """Wall-clock time (seconds since 1970) at which ``time`` was 0."""
        self.top: list[TaskId] = []
        """The tasks under the root."""
        self.tasks: dict[int, Task] = {}
        self.births = array("d")
        """When each task was sent."""
        self.messages: dict[int, Message] = {}
        self.message_of: dict[int, int] = {}
        """For each delivery that has a number of its own its message: of retries, and of what goes
        to many.
        """
        self.handlings: list[Handling] = []
        self.queueings: list[Queueing] = []
        self.copies: dict[int, list[Queueing]] = {}
        """For each message that goes to many the waits of its copies in queues."""
        self.drops: list[Drop] = []
        self.modules: dict[str, ModuleRecord] = {}
        self.claims: dict[int, Claim] = {}
        """Locks and reservations."""
        self.grants: dict[tuple[str, str], list[Claim]] = {}
        """By what the module calls itself, and resource: locks and reservations that were granted,
        in their order.
        """
        self.wanted: dict[tuple[str, str], list[Claim]] = {}
        """By the same keys all that were asked for, in that order."""
        self.runs: dict[tuple[str, str], list[Handling]] = {}
        """By module and resource, the handlings of what central delivered, as they began."""
        self.offers: dict[str, list[Offer]] = {}
        """For each message who offered to handle it, oldest first."""
        self.formats: dict[str, facts.FormatDefined] = {}
        """For each message its class and formats, as first declared."""
        self.memo: dict[object, Any] = {}
        """Results that others have worked out of the records; they check themselves whether these
        still hold.
        """

    def asker_at(self, time: float) -> Handling | str:
        """The origin of the entry of a time; "" if nobody asked."""
        place = bisect_left(self.times, time)
        return self.asked_by[place] if place < len(self.times) and self.times[place] == time else ""

    def suspensions(self) -> Iterator[Suspension]:
        """Those of tasks that were suspended themselves."""
        for task in self.tasks.values():
            yield from (one for one in task.suspensions if one.cause == task.id)

    def under(self, task: Task) -> Iterator[Task]:
        """A task, and all that is under it."""
        below = [task]
        for one in below:  # grows while it is walked
            yield one
            below += [self.tasks[child] for child in one.children]

    def children_until(self, children: Sequence[TaskId], time: float) -> Sequence[TaskId]:
        """Those of some tasks, oldest first, that had been sent at *time*."""
        if time >= self.time:
            return children
        return children[: bisect_right(children, time, key=self.sent)]

    def sent(self, task: int) -> float:
        """When a task was sent; of one that is unknown, before the journal began."""
        return self.tasks[task].received if task in self.tasks else -inf

    def granted(self, module: str, resource: str) -> list[Claim]:
        """The locks and reservations of a resource, in all copies of its module, that were granted,
        in their order.
        """
        return self.grants.get((called(module), resource), [])

    def asked_for(self, module: str, resource: str) -> list[Claim]:
        """The locks and reservations of a resource that were asked for, in that order."""
        return self.wanted.get((called(module), resource), [])

    def deadlock(self, wait: HandlerWait) -> Failure:
        """The circle in which a handler or program would have waited for ever, if that ended its
        wait; else "".
        """
        if wait.end is None or not self.deadlocks:
            return NO_FAILURE
        by = wait.by if isinstance(wait.by, str) else wait.by.module
        return self.deadlocks.get((wait.end, by), NO_FAILURE)

    def describe(self, message_id: int) -> str:
        """A message's name with its id: ``take steps {7}``."""
        return f"{self.name(message_id)} {{{message_id}}}"

    def name(self, number: int) -> str:
        """The name of a message, of the message of a delivery, or of a lock or reservation."""
        found = self.messages.get(number) or self.delivered(number) or self.claims.get(number)
        return found.name if found else UNKNOWN

    def delivered(self, delivery: int) -> Message | None:
        """The message of a delivery."""
        return self.messages.get(self.message_of.get(delivery, delivery))

    def place(self, clock: float) -> int:
        """How many entries say that they are no later than *clock*."""
        return bisect_right(self.clock, clock)
