"""Resources: how many messages a part of a module takes at a time, and who is next.

Knows capacity and order; knows nothing of constraints, messages' meaning or sockets (TCA 8.5: res.c; capacity is the
number of messages delivered and not yet completed, not the length of a queue).
"""

import heapq
from collections import OrderedDict
from collections.abc import Iterator
from typing import Generic, Protocol, TypeVar


class Queueable(Protocol):
    """What can wait for a resource. Its entry in a queue is void as soon as *ticket* differs from what it was then."""

    ticket: int
    priority: int
    arrival: int


VOID_ENTRIES = 64
"""Void entries that a queue may hold beyond as many as it has valid ones."""

S = TypeVar("S")  # what stands for a slot
Q = TypeVar("Q", bound=Queueable)


class PendingLimit(Generic[Q]):
    """At most *most* deliveries of one message wait for a resource (TCA 8.5: LimitPendingMessages)."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.waiting: OrderedDict[Q, None] = OrderedDict()  #: in the order in which they came

    def queued(self, delivery: Q) -> Q | None:
        """A delivery waits now; the one that must give way: it has waited longest, whatever its priority."""
        self.waiting[delivery] = None
        return next(iter(self.waiting)) if len(self.waiting) > self.most else None

    def left(self, delivery: Q) -> None:
        """A delivery waits no longer."""
        self.waiting.pop(delivery, None)


class Resource(Generic[S, Q]):
    """Slots that handle one message each, and the queue of those that wait: higher priority first, then arrival."""

    def __init__(self, module: str, name: str) -> None:
        self.module = module
        self.name = name
        self.slots: dict[S, None] = {}
        self.waiting = 0  #: number of valid entries in the queue
        self._free: dict[S, None] = {}
        self._queue: list[tuple[int, int, int, Q]] = []  #: (-priority, arrival, ticket, delivery), a heap

    @property
    def capacity(self) -> int:
        """How many messages it handles at a time."""
        return len(self.slots)

    @property
    def free(self) -> int:
        """Number of slots that handle nothing."""
        return len(self._free)

    def add_slot(self, slot: S) -> None:
        """A connection that handles messages for this resource came; it takes none before ``free_slot``."""
        self.slots[slot] = None

    def remove_slot(self, slot: S) -> None:
        """Such a connection is gone."""
        self.slots.pop(slot, None)
        self._free.pop(slot, None)

    def take_slot(self) -> S | None:
        """The slot that has been free longest, no longer free; None if all are busy."""
        if not self._free:
            return None
        longest_free = next(iter(self._free))
        del self._free[longest_free]
        return longest_free

    def free_slot(self, slot: S) -> None:
        """That slot's message is completed."""
        self._free[slot] = None

    def queue(self, delivery: Q) -> None:
        """Let a delivery wait its turn."""
        self.waiting += 1
        heapq.heappush(self._queue, (-delivery.priority, delivery.arrival, delivery.ticket, delivery))

    def left_queue(self) -> None:
        """An entry became void."""
        self.waiting -= 1
        if len(self._queue) > 2 * self.waiting + VOID_ENTRIES:
            self._queue = [entry for entry in self._queue if entry[3].ticket == entry[2]]
            heapq.heapify(self._queue)

    def queued(self) -> Iterator[Q]:
        """The deliveries that wait, in no particular order."""
        return (delivery for _, _, ticket, delivery in self._queue if delivery.ticket == ticket)

    def next_queued(self) -> Q | None:
        """The delivery whose turn it is; it stays in its queues until it is withdrawn from them."""
        while self._queue:
            _, _, ticket, delivery = self._queue[0]
            if delivery.ticket == ticket:
                return delivery
            heapq.heappop(self._queue)
        return None
