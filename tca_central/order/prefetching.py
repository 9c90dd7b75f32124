"""Prefetching: a fast slot gets its next messages before the slot is free.

Central recalls prefetched messages, for example when a more urgent message arrives. The slot then
returns those that it has not begun. This module decides which messages may be prefetched, and when
they are recalled. It does not decide the order of messages (docs/decisions/0068).
"""

from typing import Protocol

from tca_central.model.clock import Clock
from tca_central.model.deliveries import Connection, Delivery, Module, ModuleClaim, ModuleResource
from tca_central.model.resources import Resource
from tca_central.model.stored import Stored
from tca_wire.journal.facts import Fact
from tca_wire.rules import DELIVERED

QUICK = 0.001
"""Seconds. A slot gets prefetched messages only while its handlers take no longer than this."""
LARGEST = 16 << 10
"""Bytes. Larger messages are not prefetched, because they take memory until the slot reads them."""
QUICK_RUNS = 8
"""Number of fast runs in a row before a slot gets prefetched messages."""


class DispatchOutput(Protocol):
    """The ways in which the dispatcher's decisions leave central."""

    def deliver(self, delivery: Delivery, slot: Connection, *, is_prefetched: bool) -> None:
        """Give a slot a delivery. With *is_prefetched*, the slot has the delivery already."""

    def send_prefetched(self, delivery: Delivery, slot: Connection) -> None:
        """Send a slot a delivery before it is free."""

    def recall(self, slot: Connection) -> None:
        """Ask a slot to return prefetched deliveries that it has not begun."""


class Prefetcher(Stored):
    """The part of the dispatcher that sends messages ahead of time, and recalls them."""

    __slots__ = ("_clock", "_out", "trusts_all")

    def __init__(self, out: DispatchOutput, clock: Clock) -> None:
        self._out, self._clock = out, clock
        self.trusts_all = False  #: whether every handler counts as fast (for the explorer)

    def fill(self, resource: ModuleResource) -> None:
        """Send a resource's only slot its next messages, if nothing can overtake them."""
        if len(resource.slots) != 1 or not (resource.quick_runs >= QUICK_RUNS or self.trusts_all):
            return
        (slot,) = resource.slots
        room = slot.prefetch - len(resource.prefetched)
        running = next(iter(slot.handling), None)
        if room <= 0 or running is None or running.is_task or running.nested:
            return
        if self._clock.now - running.since > QUICK and not self.trusts_all:
            return
        for _ in range(room):
            if (delivery := resource.next_to_prefetch()) is None:
                return
            if not _can_be_prefetched(delivery, resource):
                return
            resource.mark_prefetched(delivery)
            self._out.send_prefetched(delivery, slot)

    def recall_if_overtaken(
        self, resource: Resource[Connection, Delivery], newest: Delivery | ModuleClaim
    ) -> None:
        """Recall prefetched messages if *newest* goes before one of them."""
        if resource.is_overtaken_by(newest):
            self.recall(resource)

    def revoke(self, delivery: Delivery, facts_of_drop: tuple[Fact, ...]) -> bool:
        """Recall a delivery that is dropped. Return False if no slot has prefetched it.

        The slot may have begun the delivery already, unknown to central. So *facts_of_drop* are
        recorded later: when the slot has returned the delivery, or is known to have begun it.
        """
        for resource in delivery.queues or ():
            if delivery in resource.prefetched:
                resource.prefetched[delivery] = facts_of_drop
                self.recall(resource)
                return True
        return False

    def recall(self, resource: Resource[Connection, Delivery]) -> None:
        """Recall the prefetched messages of a resource.

        The resource admits nothing until its slot has returned those that it had not begun.
        """
        slot = resource.prefetching_slot
        if resource.prefetched and slot is not None and not resource.is_recalling:
            resource.is_recalling = True
            self._out.recall(slot)


def record_run(resource: ModuleResource, seconds: float) -> None:
    """Count fast runs in a row: a handler took *seconds*."""
    resource.quick_runs = resource.quick_runs + 1 if seconds <= QUICK else 0


def first_prefetched(slot: Connection) -> Delivery | None:
    """Return the first message that a slot has prefetched; None if it has prefetched none."""
    return next(iter(slot.resource.prefetched), None) if slot.resource is not None else None


def _can_be_prefetched(delivery: Delivery, resource: ModuleResource) -> bool:
    """Whether a delivery may be prefetched, because nothing but its place in the queue matters.

    False for tasks, for messages that central made, and for large messages. Also False for messages
    that may go to another resource, or have a pending limit or a wiretap on their delivery.
    """
    message = delivery.message
    if delivery.is_task or delivery.role or len(delivery.body) > LARGEST:
        return False
    if message.taps and any(tap.at & DELIVERED for tap in message.taps):
        return False
    return delivery.queues == (resource,) and message.name not in resource.limits


def is_handled_in(resource: ModuleResource, delivery: Delivery, module: Module) -> bool:
    """Whether a message would wait in *resource* and in no other, without a pending limit.

    For a message that goes to all its handlers, the copy for *module* counts.
    """
    if delivery.message.name in resource.limits:
        return False
    if not delivery.message.fans_out:
        return delivery.message.candidates == (resource,)
    handler = module.handlers.get(delivery.message.name)
    return handler is not None and handler.resource is resource
