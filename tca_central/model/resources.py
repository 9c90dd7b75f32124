"""Resources: the slots of a part of a module, the queue for these slots, and locks.

Knows capacity and order, but no constraints, messages' meaning or sockets (TCA 8.5: res.c). The
capacity limits the messages that are delivered and not completed, not the length of the queue.

Theory of operation. Messages and claims (requests to lock or reserve) wait in one order: higher
priority first, then arrival. A claim that is first in the queue holds back all entries behind it.
When the resource is empty, the claim is granted. A lock admits nothing. A reservation admits only
messages of its owner. If a program runs in several copies, each copy of the resource has its own
slots and queue. A claim is for all copies, and waits in the queue of each. It is granted when it is
first in every queue and all copies are empty.

A resource with a single slot may *prefetch*. The slot then gets messages before it is free, and
need not wait for its next message. Prefetched messages (``prefetched``) still count as waiting, in
front of the queue. If an entry arrives that must go before one of them, central recalls the
prefetched messages. Central then admits nothing until the slot has reported which prefetched
messages it had not begun.
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
    """A message or claim that waits. A queue entry with another *ticket* is void."""

    ticket: int
    priority: int
    arrival: int
    is_task: bool

    @property
    def sent_by(self) -> object:
        """The sender. A reservation admits the messages whose sender is the reservation's owner."""


def rank(entry: Queueable) -> tuple[int, int]:
    """Return the sort key of a queue: higher priority first, then arrival."""
    return -entry.priority, entry.arrival


VOID_ENTRIES = 64
"""Void entries that a queue may hold beyond the number of valid ones."""

INSIDE = 1 << 62
"""The priority of a claim by a handler of the resource itself: higher than any other."""

S = TypeVar("S")  # a slot's type
Q = TypeVar("Q", bound=Queueable)


class PendingLimit(Stored, Generic[Q]):
    """At most *most* deliveries of a message wait for a resource (TCA: LimitPendingMessages)."""

    __slots__ = ("most", "waiting")

    def __init__(self, most: int) -> None:
        self.most = most
        self.waiting: OrderedDict[Q, None] = OrderedDict()  #: in order of arrival

    def add(self, delivery: Q) -> Q | None:
        """Add a delivery. Return the one that has waited longest if there are too many now."""
        self.waiting[delivery] = None
        return next(iter(self.waiting)) if len(self.waiting) > self.most else None

    def remove(self, delivery: Q) -> None:
        """Remove a delivery that waits no longer."""
        self.waiting.pop(delivery, None)


class Queue(Stored, Generic[Q]):
    """Waiting messages and claims: higher priority first, then arrival.

    Removing an entry from the middle of a heap is expensive. Instead, the message gets a new
    ticket, which makes the old entry void. A void entry is dropped when it reaches the front.
    """

    __slots__ = ("_heap", "waiting")

    def __init__(self) -> None:
        self.waiting = 0  #: number of valid entries
        #: (-priority, arrival, ticket, waiting entry)
        self._heap: list[tuple[int, int, int, Q]] = []

    def add(self, entry: Q) -> None:
        """Add an entry."""
        self.waiting += 1
        heapq.heappush(self._heap, (-entry.priority, entry.arrival, entry.ticket, entry))

    def mark_void(self) -> None:
        """Count one more void entry. Rebuild the heap when most entries are void."""
        self.waiting -= 1
        if not self.waiting:
            self._heap.clear()
        elif len(self._heap) > 2 * self.waiting + VOID_ENTRIES:
            self._heap = [entry for entry in self._heap if entry[3].ticket == entry[2]]
            heapq.heapify(self._heap)

    def pop_first(self) -> None:
        """Remove the entry that ``first`` has just returned."""
        heapq.heappop(self._heap)
        self.waiting -= 1

    def first(self) -> Q | None:
        """Return the next valid entry, which stays in the queue; None if the queue is empty."""
        while self._heap:
            _, _, ticket, entry = self._heap[0]
            if entry.ticket == ticket:
                return entry
            heapq.heappop(self._heap)
        return None

    def __iter__(self) -> Iterator[Q]:
        """Yield all waiting entries, in no particular order."""
        return (entry for _, _, ticket, entry in self._heap if entry.ticket == ticket)


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
        self.slot = slot  #: its sender; the claim does not wait for this slot to be free
        self.owner = owner  #: the sender whose messages a reservation admits
        self.admits_owner = admits_owner  #: whether it is a reservation
        #: The delivery at whose end the claim ends; None if it ends with its connection.
        self.holder: Q | None = None
        self.id = 0
        self.number = 0  #: the number of the request
        self.timer: Timer | None = None  #: the timeout of its wait
        self.priority = 0
        self.arrival = 0
        self.ticket = 0
        self.since = 0.0  #: when it began to wait

    @property
    def sent_by(self) -> object:
        """The claim itself, which is no reservation's owner: no reservation admits a claim."""
        return self

    @property
    def is_granted(self) -> bool:
        """Whether the claim is in force."""
        return self.resource.held_by is self


class Resource(Stored, Generic[S, Q]):
    """Slots that handle one message each, and the queue for them."""

    __slots__ = (
        "_free",
        "_queue",
        "_sent_by",
        "claims",
        "copies",
        "held_by",
        "is_recalling",
        "lendable",
        "locked_out_queries",
        "module",
        "name",
        "numbers",
        "prefetched",
        "prefetching_slot",
        "slots",
    )

    def __init__(self, module: str, name: str) -> None:
        self.module = module
        self.name = name
        #: The same resource in all copies of its module, itself included; one shared list.
        self.copies: list[Resource[S, Q]] = [self]
        self.slots: dict[S, None] = {}
        self.numbers: dict[S, int] = {}  #: by slot, from 1; a new slot gets the lowest free number
        self.held_by: Claim[S, Q] | None = None  #: the lock or reservation in force
        self.claims: dict[Claim[S, Q], None] = {}  #: waiting claims, oldest first
        #: By query that a lock keeps out: the slot of this resource that waits for the reply.
        self.locked_out_queries: dict[Q, S] = {}
        #: By queued task: the slot of this resource that handles its nearest such ancestor.
        self.lendable: dict[Q, S] = {}
        self.prefetched: dict[Q, tuple[Fact, ...] | None] = {}
        """Messages that its only slot has prefetched and, as far as central knows, not begun.

        The value is None, unless the message was dropped in the meantime. Then the value is the
        facts of the drop. They are recorded when the slot has returned or begun the message.
        """
        #: The slot that has, or had, the prefetched messages.
        self.prefetching_slot: S | None = None
        #: Whether the slot has yet to return the prefetched messages that it has not begun.
        self.is_recalling = False
        self._free: dict[S, None] = {}
        self._queue: Queue[Q | Claim[S, Q]] = Queue()
        #: The queue split by sender; built at the first reservation.
        self._sent_by: dict[object, Queue[Q]] | None = None

    @property
    def waiting(self) -> int:
        """The number of messages that wait, including prefetched ones."""
        return self._queue.waiting - len(self.claims) + len(self.prefetched)

    @property
    def capacity(self) -> int:
        """The number of messages that the resource can handle at a time."""
        return len(self.slots)

    @property
    def free(self) -> int:
        """The number of free slots."""
        return len(self._free)

    def add_slot(self, slot: S) -> None:
        """Add a slot. It gets no message before ``free_slot``."""
        self.numbers[slot] = min({*range(1, len(self.slots) + 2)}.difference(self.numbers.values()))
        self.slots[slot] = None

    def remove_slot(self, slot: S) -> None:
        """Remove a slot whose connection has closed."""
        self.slots.pop(slot, None)
        self.numbers.pop(slot, None)
        self._free.pop(slot, None)
        if slot is self.prefetching_slot:
            self.prefetching_slot = None

    @property
    def is_locked(self) -> bool:
        """Whether a lock is in force."""
        return self.held_by is not None and not self.held_by.admits_owner

    def is_free(self, slot: S) -> bool:
        """Whether a slot handles nothing."""
        return slot in self._free

    def slot_for(self, message: Q) -> S | None:
        """Take a free slot for a message that has just arrived; None if it must wait."""
        if not self._free or self.prefetched or self.is_recalling or not self.admits(message):
            return None
        if self._queue.waiting and self._is_behind(message):
            return None
        return self.acquire_slot()

    def admits(self, message: Q) -> bool:
        """Whether no lock or reservation keeps a message out."""
        held_by = self.held_by
        return held_by is None or (held_by.admits_owner and message.sent_by is held_by.owner)

    def _is_behind(self, message: Q) -> bool:
        """Whether something in the queue goes before a new message.

        That may be a claim or, if a lock has just ended, a message.
        """
        first = self._first_in_line()
        return first is not None and rank(first) < rank(message)

    def acquire_slot(self) -> S:
        """Take the slot that has prefetched messages, or else the slot that was free longest."""
        slot = self.prefetching_slot if self.prefetched else None
        if slot is None:
            slot = next(iter(self._free))
        del self._free[slot]
        return slot

    def free_slot(self, slot: S) -> None:
        """Mark a slot free: its message is completed."""
        self._free[slot] = None

    # --- the queue --------------------------------------------------------------------------------

    def queue(self, message: Q) -> None:
        """Queue a message."""
        self._queue.add(message)
        if self._sent_by is not None:
            self._add_by_sender(self._sent_by, message)

    @staticmethod
    def _add_by_sender(sent_by: dict[object, Queue[Q]], message: Q) -> None:
        """Add a message to the queue of its sender."""
        sender = message.sent_by
        if sender not in sent_by:
            sent_by[sender] = Queue()
        sent_by[sender].add(message)

    def leave_queue(self, message: Q) -> None:
        """Remove a message whose entry in the queue has become void."""
        if self.locked_out_queries:
            self.locked_out_queries.pop(message, None)
        if self.lendable:
            self.lendable.pop(message, None)
        if message in self.prefetched:
            del self.prefetched[message]
            return
        self._queue.mark_void()
        if self._sent_by is not None:
            of_sender = self._sent_by[message.sent_by]
            of_sender.mark_void()
            if not of_sender.waiting:
                del self._sent_by[message.sent_by]

    def queued(self) -> Iterator[Q]:
        """Yield the waiting messages, in no particular order."""
        return chain(
            self.prefetched, (entry for entry in self._queue if not isinstance(entry, Claim))
        )

    def first_message(self) -> Q | None:
        """Return the first waiting message; if a claim is first in the queue, any message in it."""
        self._queue.first()  # drops void entries at the front
        return next(self.queued(), None)

    def in_line(self) -> list[Q | Claim[S, Q]]:
        """Return the waiting messages and claims, the next one first."""
        return [*self.prefetched, *sorted(self._queue, key=rank)]

    def next_queued(self) -> Q | Claim[S, Q] | None:
        """Return the message to admit next, or the claim to grant now; None if there is neither."""
        if self.is_recalling:
            return None
        first = self._first_in_line()
        if isinstance(first, Claim) and not self._can_be_granted(first):
            return None
        return first

    def next_non_task(self) -> Q | None:
        """Return the next message to admit while tasks may not start; None if a claim is first."""
        others = [
            entry
            for entry in self._queue
            if not entry.is_task and (isinstance(entry, Claim) or self.admits(entry))
        ]
        first = min(others, key=rank, default=None)
        return None if isinstance(first, Claim) or self.is_recalling else first

    # --- prefetched messages ----------------------------------------------------------------------

    def next_to_prefetch(self) -> Q | None:
        """Return the message to prefetch next; None if something may overtake this message."""
        if (
            self.is_recalling
            or self.claims
            or self.held_by is not None
            or self._sent_by is not None
        ):
            return None
        first = self._queue.first() if len(self.slots) == 1 else None
        return None if isinstance(first, Claim) else first

    def mark_prefetched(self, first: Q) -> S:
        """Mark the first message in the queue as prefetched. Return its slot."""
        self._queue.pop_first()
        self.prefetched[first] = None
        self.prefetching_slot = next(iter(self.slots))
        return self.prefetching_slot

    def requeue_prefetched(self, message: Q) -> tuple[Fact, ...] | None:
        """Queue a prefetched message again.

        If it was dropped in the meantime, return the facts to record.
        """
        message.ticket += 1
        self._queue.add(message)
        return self.prefetched.pop(message)

    def is_overtaken_by(self, newest: "Q | Claim[S, Q]") -> bool:
        """Whether *newest*, which has just arrived, goes before a prefetched message."""
        if not self.prefetched:
            return False
        last = next(reversed(self.prefetched))
        if newest.priority == last.priority:
            return newest.arrival < last.arrival
        return newest.priority > last.priority

    def _first_in_line(self) -> Q | Claim[S, Q] | None:
        """Return the first of the entries that no lock or reservation in force keeps out."""
        if self.prefetched:
            return next(iter(self.prefetched))
        if self.held_by is None:
            return self._queue.first()
        if not self.held_by.admits_owner:
            return None
        if self._sent_by is None:
            self._sent_by = {}
            for message in self.queued():
                self._add_by_sender(self._sent_by, message)
        mine = self._sent_by.get(self.held_by.owner)
        return mine.first() if mine is not None else None

    # --- claims -----------------------------------------------------------------------------------

    def join_copies(self, other: "Resource[S, Q]") -> None:
        """Become a copy of *other*, so that its locks and claims are for this resource too."""
        self.copies = other.copies
        self.copies.append(self)
        self.held_by = other.held_by
        for claim in other.claims:
            self._queue_claim(claim)

    def leave_copies(self) -> "Resource[S, Q] | None":
        """Leave the copies. Return the copy that inherits the claims; None if no copy remains."""
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

    def _can_be_granted(self, claim: Claim[S, Q]) -> bool:
        """Whether a claim is first in every copy's queue, and only the claimant's slot is busy.

        A copy that recalls messages may still handle one.
        """
        if any(
            copy.is_recalling or copy._first_in_line() is not claim  # noqa: SLF001
            for copy in self.copies
        ):
            return False
        inside = [slot for copy in self.copies for slot in copy.slots if not copy.is_free(slot)]
        return not inside or inside == [claim.slot]

    def add_claim(self, claim: Claim[S, Q]) -> None:
        """Queue a claim.

        A claim by a handler of the resource goes first. The handler's slot is busy until the
        handler returns. Until then no other claim could be granted.
        """
        if any(claim.slot in copy.slots and not copy.is_free(claim.slot) for copy in self.copies):
            claim.priority = INSIDE
        for copy in self.copies:
            copy._queue_claim(claim)  # noqa: SLF001

    def _queue_claim(self, claim: Claim[S, Q]) -> None:
        """Queue a claim in this copy."""
        self.claims[claim] = None
        self._queue.add(claim)

    def end_claim(self, claim: Claim[S, Q]) -> None:
        """End a claim, granted or not."""
        if self.held_by is not claim:
            self._leave_queues(claim)
            return
        for copy in self.copies:
            copy.held_by = None

    def grant(self, claim: Claim[S, Q]) -> None:
        """Grant a claim. From now on the claim excludes all other claims."""
        self._leave_queues(claim)
        for copy in self.copies:
            copy.held_by = claim

    def _leave_queues(self, claim: Claim[S, Q]) -> None:
        """Remove a claim from the queues of all copies."""
        claim.ticket += 1
        for copy in self.copies:
            del copy.claims[claim]
            copy._queue.mark_void()  # noqa: SLF001
