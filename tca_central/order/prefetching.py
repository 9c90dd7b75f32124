"""Prefetching: a fast slot gets its next messages before it is free.

It returns those that are overtaken. This module decides which messages may be prefetched, and what
recalls them. It does not decide the order (docs/decisions/0068).
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
"""Bytes. Larger messages are not prefetched: on their way they take memory until they are read."""
QUICK_RUNS = 8
"""Number of fast runs in a row before a slot gets prefetched messages."""


class DispatchOutput(Protocol):
    """The ways in which the dispatcher's decisions leave central."""

    def deliver(self, delivery: Delivery, slot: Connection, *, is_prefetched: bool) -> None:
        """Give a slot a delivery; *is_prefetched*: the slot has it already."""

    def send_prefetched(self, delivery: Delivery, slot: Connection) -> None:
        """Send a slot a delivery before it is free."""

    def recall(self, slot: Connection) -> None:
        """Ask a slot to return prefetched deliveries that it has not begun."""


class Prefetcher(Stored):
    """Sends messages for prefetching, and recalls them."""

    __slots__ = ("_clock", "_out", "trusts_all")

    def __init__(self, out: DispatchOutput, clock: Clock) -> None:
        self._out, self._clock = out, clock
        self.trusts_all = False  #: every handler counts as fast: for the explorer

    def fill(self, resource: ModuleResource) -> None:
        """Send a resource's only slot its next messages, if nothing can overtake them."""
        if len(resource.slots) != 1 or not (resource.quick_runs >= QUICK_RUNS or self.trusts_all):
            return
        (slot,) = resource.slots
        running = next(iter(slot.handling), None)
        if running is None or running.is_task:
            return
        if self._clock.now - running.since > QUICK and not self.trusts_all:
            return
        while (
            len(resource.prefetched) < slot.prefetch
            and (delivery := resource.next_to_prefetch()) is not None
        ):
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
        """Take back a delivery, if a slot has prefetched it. Return whether one has.

        The slot may have begun it. *facts_of_drop* are recorded when the slot has returned or begun
        it.
        """
        for resource in delivery.queues or ():
            if delivery in resource.prefetched:
                resource.prefetched[delivery] = facts_of_drop
                self.recall(resource)
                return True
        return False

    def recall(self, resource: Resource[Connection, Delivery]) -> None:
        """Admit nothing to a resource until its slot has returned what it had not begun."""
        slot = resource.prefetching_slot
        if resource.prefetched and slot is not None and not resource.is_recalling:
            resource.is_recalling = True
            self._out.recall(slot)


def record_run(resource: ModuleResource, seconds: float) -> None:
    """Record how long a handler took."""
    resource.quick_runs = resource.quick_runs + 1 if seconds <= QUICK else 0


def first_prefetched(slot: Connection) -> Delivery | None:
    """Return the message that a slot will handle next, if it has prefetched it."""
    return next(iter(slot.resource.prefetched), None) if slot.resource is not None else None


def _can_be_prefetched(delivery: Delivery, resource: ModuleResource) -> bool:
    """Whether only its place in the queue decides when a delivery is handled.

    It is not a task, waits for no other resource, and no wiretap fires when it is delivered. Nor is
    it large.
    """
    message = delivery.message
    if delivery.is_task or delivery.role or any(tap.at & DELIVERED for tap in message.taps):
        return False
    is_alone = delivery.queues == (resource,) and message.name not in resource.limits
    return is_alone and len(delivery.body) <= LARGEST


def is_handled_in(resource: ModuleResource, delivery: Delivery, module: Module) -> bool:
    """Whether a message, or its copy for a module, would wait in that resource and in no other."""
    if delivery.message.name in resource.limits:
        return False
    if not delivery.message.fans_out:
        return delivery.message.candidates == (resource,)
    handler = module.handlers.get(delivery.message.name)
    return handler is not None and handler.resource is resource
