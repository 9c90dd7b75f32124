"""Resources: how many messages a part of a module takes at a time, and who is next.

Knows capacity and order; knows nothing of constraints, messages' meaning or sockets (TCA 8.5: res.c; capacity is the
number of messages delivered and not yet completed, not the length of a queue).
"""

import heapq
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tca_central.registry import Connection, MessageType


class Delivery:
    """One message on its way to one handler."""

    __slots__ = ("body", "id", "message", "message_id", "nested", "number", "priority", "queues", "sender", "slot",
                 "ticket")  # fmt: skip

    def __init__(self, delivery_id: int, message: "MessageType", body: bytes, sender: "Connection | None") -> None:
        self.id = delivery_id
        self.message_id = delivery_id
        self.message = message
        self.body = body
        self.sender = sender  #: who wants the answer; None when it is gone
        self.number = 0  #: of the sender's request (0: no answer wanted)
        self.priority = 0
        self.ticket = 0  #: place in the queues; a queue entry with another ticket is void
        self.queues: tuple[Resource, ...] | None = None  #: where it waits; () while no handler is there, None: nowhere
        self.slot: Connection | None = None  #: the connection whose thread handles it
        self.nested = False  #: handled inside a wait of its slot's own, beyond the capacity

    def withdraw(self) -> None:
        """Leave the queues."""
        for resource in self.queues or ():
            resource.left_queue()
        self.queues = None
        self.ticket += 1


class Resource:
    """Slots that handle one message each, and the queue of those that wait: higher priority first, then arrival."""

    def __init__(self, module: str, name: str) -> None:
        self.module = module
        self.name = name
        self.capacity = 0  #: number of slots
        self.waiting = 0  #: number of valid entries in the queue
        self._free: dict[Connection, None] = {}
        self._queue: list[tuple[int, int, int, Any]] = []  #: (-priority, arrival, ticket, delivery), a heap
        self._arrivals = 0

    @property
    def free(self) -> int:
        """Number of slots that handle nothing."""
        return len(self._free)

    def add_slot(self, slot: "Connection") -> None:
        """A connection that handles messages for this resource came."""
        self.capacity += 1
        self._free[slot] = None

    def remove_slot(self, slot: "Connection") -> None:
        """Such a connection is gone."""
        self.capacity -= 1
        self._free.pop(slot, None)

    def take_slot(self) -> "Connection | None":
        """The slot that has been free longest, no longer free; None if all are busy."""
        if not self._free:
            return None
        longest_free = next(iter(self._free))
        del self._free[longest_free]
        return longest_free

    def free_slot(self, slot: "Connection") -> None:
        """That slot's message is completed."""
        self._free[slot] = None

    def queue(self, delivery: Delivery) -> None:
        """Let a delivery wait its turn."""
        self._arrivals += 1
        self.waiting += 1
        heapq.heappush(self._queue, (-delivery.priority, self._arrivals, delivery.ticket, delivery))

    def left_queue(self) -> None:
        """An entry became void."""
        self.waiting -= 1
        if not self.waiting:
            self._queue.clear()

    def queued(self) -> Iterator[Delivery]:
        """The deliveries that wait, in no particular order."""
        return (delivery for _, _, ticket, delivery in self._queue if delivery.ticket == ticket)

    def next_queued(self) -> Delivery | None:
        """The delivery whose turn it is; it stays in its queues until it is withdrawn from them."""
        while self._queue:
            _, _, ticket, delivery = self._queue[0]
            if delivery.ticket == ticket:
                return delivery  # type: ignore[no-any-return]
            heapq.heappop(self._queue)
        return None
