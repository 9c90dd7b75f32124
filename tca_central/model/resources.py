"""Resources: the slots of a part of a module, the queue for them, and locks.

Knows capacity and order; knows nothing of constraints, messages' meaning or sockets (TCA 8.5:
res.c; capacity is the number of messages delivered and not yet completed, not the length of a
queue).

Theory of operation. Messages and claims (requests to lock or reserve) wait in one order: higher
priority first, then arrival. A claim whose turn has come holds back all behind it until nobody is
in the resource; then it is granted. While a lock is held nobody is let in, while a reservation is,
only what its owner sends. Where a program runs in several copies, each has its slots and its queue;
a claim is for all of them, waits in each queue, and is granted when its turn has come in each and
nobody is in any.

The slot of a resource that has only one may have messages *ahead*: it was sent them before it is
free, so that it need not wait for the next. They still wait, before all others in the queue, and
nothing may come between: if something that goes first comes, they are recalled, and nobody is let
in until the slot has said which it had not begun.
"""

import heapq
from collections import OrderedDict
from collections.abc import Iterator
from itertools import chain
from typing import Generic, Protocol, TypeVar

from tca_central.model.clock import Timer
from tca_central.model.stored import Stored
from tca_wire.journal.facts import Fact


class Queueable(Protocol):
    """A message or claim that waits. Its queue entry is void once *ticket* has changed."""

    ticket: int
    priority: int
    arrival: int
    is_task: bool

    @property
    def sent_by(self) -> object:
        """The sender, as reservations compare it."""


VOID_ENTRIES = 64
"""Void entries that a queue may hold beyond as many as it has valid ones."""

INSIDE = 1 << 62
"""Higher than any priority: of who claims a resource from inside it."""

S = TypeVar("S")  # a slot's type
Q = TypeVar("Q", bound=Queueable)


class PendingLimit(Stored, Generic[Q]):
    """At most *most* deliveries of one message wait for a resource (TCA 8.5:
    LimitPendingMessages).
    """

    __slots__ = ("most", "waiting")

    def __init__(self, most: int) -> None:
        self.most = most
        self.waiting: OrderedDict[Q, None] = OrderedDict()  #: in the order in which they came

    def add(self, delivery: Q) -> Q | None:
        """A delivery waits now; the one that must give way: it has waited longest, whatever its
        priority.
        """
        self.waiting[delivery] = None
        return next(iter(self.waiting)) if len(self.waiting) > self.most else None

    def remove(self, delivery: Q) -> None:
        """A delivery waits no longer."""
        self.waiting.pop(delivery, None)


class Queue(Stored, Generic[Q]):
    """Waiting messages and claims: higher priority first, then arrival."""

    __slots__ = ("_heap", "waiting")

    def __init__(self) -> None:
        self.waiting = 0  #: number of valid entries
        self._heap: list[
            tuple[int, int, int, Q]
        ] = []  #: (-priority, arrival, ticket, waiting entry)

    def put(self, one: Q) -> None:
        """Let one more wait."""
        self.waiting += 1
        heapq.heappush(self._heap, (-one.priority, one.arrival, one.ticket, one))

    def mark_void(self) -> None:
        """An entry became void."""
        self.waiting -= 1
        if not self.waiting:
            self._heap.clear()
        elif len(self._heap) > 2 * self.waiting + VOID_ENTRIES:
            self._heap = [entry for entry in self._heap if entry[3].ticket == entry[2]]
            heapq.heapify(self._heap)

    def first(self) -> Q | None:
        """The next in line; it stays until it is withdrawn."""
        while self._heap:
            _, _, ticket, one = self._heap[0]
            if one.ticket == ticket:
                return one
            heapq.heappop(self._heap)
        return None

    def __iter__(self) -> Iterator[Q]:
        """All waiting entries, in no particular order."""
        return (one for _, _, ticket, one in self._heap if one.ticket == ticket)


class Claim(Stored, Generic[S, Q]):
    """A lock or reservation that is wanted or held."""

    is_task = False

    __slots__ = (
        "admits_owner",
        "arrival",
        "holder",
        "id",
        "number",
        "owner",
        "priority",
        "resource",
        "since",
        "slot",
        "ticket",
        "timer",
    )

    def __init__(
        self, resource: "Resource[S, Q]", slot: S, owner: object, *, admits_owner: bool
    ) -> None:
        self.resource = resource
        self.slot = slot  #: its sender; a slot of the resource does not wait for itself
        self.owner = owner  #: whose messages a reservation lets in
        self.admits_owner = admits_owner  #: it is a reservation
        self.holder: Q | None = (
            None  #: the delivery at whose end it ends; None: it ends with its connection
        )
        self.id = 0
        self.number = 0  #: of the request
        self.timer: Timer | None = None  #: when it has waited long enough
        self.priority = 0
        self.arrival = 0
        self.ticket = 0
        self.since = 0.0  #: when it began to wait

    @property
    def sent_by(self) -> object:
        """Nobody: a claim is not let in by a reservation."""
        return self

    @property
    def is_granted(self) -> bool:
        """Whether it has the resource."""
        return self.resource.held_by is self


class Resource(Stored, Generic[S, Q]):
    """Slots that handle one message each, and those that wait for one."""

    __slots__ = (
        "_free",
        "_queue",
        "_sent_by",
        "ahead",
        "ahead_at",
        "called_back",
        "claims",
        "copies",
        "held_by",
        "is_recalling",
        "module",
        "name",
        "numbers",
        "slots",
    )

    def __init__(self, module: str, name: str) -> None:
        self.module = module
        self.name = name
        self.copies: list[Resource[S, Q]] = [
            self
        ]  #: it, and the same resource of other copies of its module; one list
        self.slots: dict[S, None] = {}
        self.numbers: dict[S, int] = {}  #: by slot, from 1; a new one gets the lowest that is free
        self.held_by: Claim[S, Q] | None = None  #: the lock or reservation in force
        self.claims: dict[Claim[S, Q], None] = {}  #: those that wait, oldest first
        self.called_back: dict[
            Q, S
        ] = {}  #: its slots' own questions that a lock keeps out -> the asking slot
        self.ahead: dict[Q, tuple[Fact, ...] | None] = {}
        """Messages that its only slot has already, and has not begun as far as is known -> None or,
        of one that nobody wants any more, the facts to be recorded when the slot has said whether
        it had begun it.
        """
        self.ahead_at: S | None = None  #: the slot that has, or had, them
        self.is_recalling = False  #: the slot has yet to say which of them it had not begun
        self._free: dict[S, None] = {}
        self._queue: Queue[Q | Claim[S, Q]] = Queue()
        self._sent_by: dict[object, Queue[Q]] | None = (
            None  #: the same messages by sender, once it was reserved
        )

    @property
    def waiting(self) -> int:
        """Number of messages that wait."""
        return self._queue.waiting - len(self.claims) + len(self.ahead)

    @property
    def capacity(self) -> int:
        """The number of messages that it handles at a time."""
        return len(self.slots)

    @property
    def free(self) -> int:
        """Number of slots that handle nothing."""
        return len(self._free)

    def add_slot(self, slot: S) -> None:
        """A connection that handles messages for this resource came; it takes none before
        ``free_slot``.
        """
        self.numbers[slot] = min({*range(1, len(self.slots) + 2)}.difference(self.numbers.values()))
        self.slots[slot] = None

    def remove_slot(self, slot: S) -> None:
        """Such a connection is gone."""
        self.slots.pop(slot, None)
        self.numbers.pop(slot, None)
        self._free.pop(slot, None)
        if slot is self.ahead_at:
            self.ahead_at = None

    @property
    def is_locked(self) -> bool:
        """Whether nobody at all is let in."""
        return self.held_by is not None and not self.held_by.admits_owner

    def is_free(self, slot: S) -> bool:
        """Whether a slot handles nothing."""
        return slot in self._free

    def slot_for(self, message: Q) -> S | None:
        """A free slot for a message that has just come, no longer free; None if it must wait."""
        if not self._free or self.ahead or self.is_recalling or not self.admits(message):
            return None
        if self._queue.waiting and self._is_behind(message):
            return None
        return self.take_slot()

    def admits(self, message: Q) -> bool:
        """Whether neither a lock nor a reservation keeps a message out."""
        held_by = self.held_by
        return held_by is None or (held_by.admits_owner and message.sent_by is held_by.owner)

    def _is_behind(self, message: Q) -> bool:
        """Whether something waits that goes first: a claim or, where a lock has just ended, a
        message.
        """
        first = self._first_in_line()
        return first is not None and (-first.priority, first.arrival) < (
            -message.priority,
            message.arrival,
        )

    def take_slot(self) -> S:
        """The slot that has been free longest, or that has the next message already; no longer
        free.
        """
        slot = self.ahead_at if self.ahead and self.ahead_at is not None else next(iter(self._free))
        del self._free[slot]
        return slot

    def free_slot(self, slot: S) -> None:
        """Mark a slot free: its message is completed."""
        self._free[slot] = None

    # --- those that wait --------------------------------------------------------------------------

    def queue(self, one: Q) -> None:
        """Let a message wait its turn."""
        self._queue.put(one)
        if self._sent_by is not None:
            self._sort_in(self._sent_by, one)

    @staticmethod
    def _sort_in(sent_by: dict[object, Queue[Q]], one: Q) -> None:
        sender = one.sent_by
        if sender not in sent_by:
            sent_by[sender] = Queue()
        sent_by[sender].put(one)

    def leave_queue(self, one: Q) -> None:
        """A message waits no longer; its entries have become void."""
        if self.called_back:
            self.called_back.pop(one, None)
        if one in self.ahead:
            del self.ahead[one]
            return
        self._queue.mark_void()
        if self._sent_by is not None:
            of_sender = self._sent_by[one.sent_by]
            of_sender.mark_void()
            if not of_sender.waiting:
                del self._sent_by[one.sent_by]

    def queued(self) -> Iterator[Q]:
        """The messages that wait, in no particular order."""
        return chain(self.ahead, (one for one in self._queue if not isinstance(one, Claim)))

    def first_message(self) -> Q | None:
        """A message that waits before the others, whatever claims do."""
        self._queue.first()  # removes void entries before it
        return next(self.queued(), None)

    def in_line(self) -> list[Q | Claim[S, Q]]:
        """Messages and claims that wait, in their order."""
        return [*self.ahead, *sorted(self._queue, key=lambda one: (-one.priority, one.arrival))]

    def next_queued(self) -> Q | Claim[S, Q] | None:
        """The next that may be let in: a message, or a claim that is to be granted now."""
        if self.is_recalling:
            return None
        first = self._first_in_line()
        if isinstance(first, Claim) and not self._may_have(first):
            return None
        return first

    def next_question(self) -> Q | None:
        """The next that may be let in where tasks may not; none that is behind a claim."""
        others = [
            one
            for one in self._queue
            if not one.is_task and (isinstance(one, Claim) or self.admits(one))
        ]
        first = min(others, key=lambda one: (-one.priority, one.arrival), default=None)
        return None if isinstance(first, Claim) or self.is_recalling else first

    # --- messages ahead ---------------------------------------------------------------------------

    def next_ahead(self) -> Q | None:
        """The message that may be sent ahead next; None if something may come between."""
        if (
            self.is_recalling
            or self.claims
            or self.held_by is not None
            or self._sent_by is not None
        ):
            return None
        first = self._queue.first() if len(self.slots) == 1 else None
        return None if isinstance(first, Claim) else first

    def send_ahead(self, first: Q) -> S:
        """The first message in the queue goes to the slot, which is returned."""
        first.ticket += 1
        self._queue.mark_void()
        self.ahead[first] = None
        self.ahead_at = next(iter(self.slots))
        return self.ahead_at

    def take_back(self, message: Q) -> tuple[Fact, ...] | None:
        """The slot does not have a message any more, which waits as before; the facts, if nobody
        wants it any more.
        """
        self._queue.put(message)
        return self.ahead.pop(message)

    def is_overtaken_by(self, newest: "Q | Claim[S, Q]") -> bool:
        """Whether what has just come goes before a message that the slot has already."""
        if not self.ahead:
            return False
        last = next(reversed(self.ahead))
        return (-newest.priority, newest.arrival) < (-last.priority, last.arrival)

    def _first_in_line(self) -> Q | Claim[S, Q] | None:
        """The next in line among those that the lock or reservation in force admits."""
        if self.ahead:
            return next(iter(self.ahead))
        if self.held_by is None:
            return self._queue.first()
        if not self.held_by.admits_owner:
            return None
        if self._sent_by is None:
            self._sent_by = {}
            for one in self.queued():
                self._sort_in(self._sent_by, one)
        mine = self._sent_by.get(self.held_by.owner)
        return mine.first() if mine is not None else None

    # --- claims -----------------------------------------------------------------------------------

    def join_copies(self, other: "Resource[S, Q]") -> None:
        """Become a copy of another resource: its locks and claims cover this one too."""
        self.copies = other.copies
        self.copies.append(self)
        self.held_by = other.held_by
        for claim in other.claims:
            self._wait(claim)

    def leave_copies(self) -> "Resource[S, Q] | None":
        """Leave the copies; another one, if there is one, goes on with the claims and is
        returned.
        """
        self.copies.remove(self)
        if not self.copies:
            self.copies = [self]
            return None
        newest, self.copies = self.copies[-1], [self]
        for claim in (*newest.claims, newest.held_by):
            if claim is not None and claim.resource is self:
                claim.resource = newest
        self.held_by, self.claims, self._queue = None, {}, Queue()  # messages wait here no longer
        return newest

    def _may_have(self, claim: Claim[S, Q]) -> bool:
        """Whether it is a claim's turn here and in all copies, with nobody in them but the
        claimant.
        """
        if any(one._first_in_line() is not claim for one in self.copies):  # noqa: SLF001 - its copies
            return False
        inside = [slot for one in self.copies for slot in one.slots if not one.is_free(slot)]
        return not inside or inside == [claim.slot]

    def add_claim(self, claim: Claim[S, Q]) -> None:
        """Add a claim. A slot in use that claims goes first: the resource is not idle before its
        handler returns.
        """
        if any(claim.slot in one.slots and not one.is_free(claim.slot) for one in self.copies):
            claim.priority = INSIDE
        for one in self.copies:
            one._wait(claim)  # noqa: SLF001

    def _wait(self, claim: Claim[S, Q]) -> None:
        self.claims[claim] = None
        self._queue.put(claim)

    def end_claim(self, claim: Claim[S, Q]) -> None:
        """Withdraw a claim."""
        if self.held_by is not claim:
            self._leave_queues(claim)
            return
        for one in self.copies:
            one.held_by = None

    def grant(self, claim: Claim[S, Q]) -> None:
        """Nobody else gets in from now on."""
        self._leave_queues(claim)
        for one in self.copies:
            one.held_by = claim

    def _leave_queues(self, claim: Claim[S, Q]) -> None:
        claim.ticket += 1
        for one in self.copies:
            del one.claims[claim]
            one._queue.mark_void()  # noqa: SLF001
