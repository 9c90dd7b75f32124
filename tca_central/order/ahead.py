"""Messages ahead: a quick slot has its next messages before it is free, and gives back what others
come before.

Knows which may go, and what calls them back; nothing of who is next (docs/decisions/0068).
"""

from typing import Protocol

from tca_central.model.clock import Clock
from tca_central.model.deliveries import Connection, Delivery, Module, ModuleClaim, ModuleResource
from tca_central.model.resources import Resource
from tca_central.model.stored import Stored
from tca_wire.journal.facts import Fact
from tca_wire.rules import DELIVERED

QUICK = 0.001
"""Seconds: messages are sent ahead to slots whose handlers have taken no longer of late."""
LARGEST = 16 << 10
"""Bytes of data: larger messages are not sent ahead, for what is on its way to a slot takes room
until it is read.
"""
QUICK_RUNS = 8
"""So many messages must have been handled quickly, one after the other, before one is sent
ahead.
"""


class Out(Protocol):
    """The ways in which what is decided here, and by the dispatcher, leaves central."""

    def deliver(self, delivery: Delivery, slot: Connection, *, is_there: bool) -> None:
        """A slot handles a delivery; whether it *is there* already."""

    def send_ahead(self, delivery: Delivery, slot: Connection) -> None:
        """A slot gets a delivery before it is free."""

    def recall(self, slot: Connection) -> None:
        """A slot is to give back what it has ahead and has not begun."""


class MessagesAhead(Stored):
    """Sends messages ahead, and recalls them."""

    __slots__ = ("_clock", "_out", "trusts_all")

    def __init__(self, out: Out, clock: Clock) -> None:
        self._out, self._clock = out, clock
        self.trusts_all = False  #: every handler counts as a quick one: for explorations

    def fill(self, resource: ModuleResource) -> None:
        """Send the slot ahead what it will handle next, where nothing can come between."""
        if len(resource.slots) != 1 or not (resource.quick_runs >= QUICK_RUNS or self.trusts_all):
            return
        (slot,) = resource.slots
        running = next(iter(slot.handling), None)
        if running is None or running.is_task:
            return
        if self._clock.now - running.since > QUICK and not self.trusts_all:
            return
        while (
            len(resource.ahead) < slot.prefetch and (delivery := resource.next_ahead()) is not None
        ):
            if not _may_go_ahead(delivery, resource):
                return
            resource.send_ahead(delivery)
            self._out.send_ahead(delivery, slot)

    def make_way(
        self, resource: Resource[Connection, Delivery], newest: Delivery | ModuleClaim
    ) -> None:
        """Recall what is ahead if something has come that goes before it."""
        if resource.is_overtaken_by(newest):
            self.recall(resource)

    def revoke(self, delivery: Delivery, dropped: tuple[Fact, ...]) -> bool:
        """Whether a slot has a delivery ahead, which nobody wants any more: it waits until that
        gives it back, or has begun it.
        """
        for resource in delivery.queues or ():
            if delivery in resource.ahead:
                resource.ahead[delivery] = dropped
                self.recall(resource)
                return True
        return False

    def recall(self, resource: Resource[Connection, Delivery]) -> None:
        """Let nobody in before the slot has said which messages it had not begun."""
        if resource.ahead and resource.ahead_at is not None and not resource.is_recalling:
            resource.is_recalling = True
            self._out.recall(resource.ahead_at)


def note_run(resource: ModuleResource, seconds: float) -> None:
    """A handler has taken so long."""
    resource.quick_runs = resource.quick_runs + 1 if seconds <= QUICK else 0


def first_ahead(slot: Connection) -> Delivery | None:
    """What a slot handles next, if it has that already."""
    return next(iter(slot.resource.ahead), None) if slot.resource is not None else None


def _may_go_ahead(delivery: Delivery, resource: ModuleResource) -> bool:
    """Whether nothing but its place in the queue decides when a delivery is handled: it is no task,
    waits for nothing else, and nobody listens when it is delivered.
    """
    message = delivery.message
    is_plain = (
        not delivery.is_task
        and not delivery.role
        and not any(tap.at & DELIVERED for tap in message.taps)
    )
    is_plain = is_plain and len(delivery.body) <= LARGEST
    return is_plain and delivery.queues == (resource,) and message.name not in resource.limits


def is_handled_in(resource: ModuleResource, delivery: Delivery, module: Module) -> bool:
    """Whether a message, or the copy for a module, waits there, and nowhere else."""
    if delivery.message.name in resource.limits:
        return False
    if not delivery.message.fans_out:
        return delivery.message.candidates == (resource,)
    handler = module.handlers.get(delivery.message.name)
    return handler is not None and handler.resource is resource
