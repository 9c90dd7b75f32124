"""The dispatcher brings deliveries to handlers: it chooses resources, and assigns free slots.

The dispatcher knows the handlers of messages and the order of resources, but no points or
constraints. It reports each delivery through ``DispatchOutput``.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from operator import attrgetter

from tca_central.model.budget import DELIVERY_BYTES
from tca_central.model.clock import Clock
from tca_central.model.deliveries import (
    Connection,
    Delivery,
    Handler,
    MessageType,
    Module,
    ModuleClaim,
    ModuleResource,
)
from tca_central.model.resources import Claim, PendingLimit, Resource, rank
from tca_central.model.stored import Stored
from tca_central.order.lending import Lending, own_slot
from tca_central.order.prefetching import (
    DispatchOutput,
    Prefetcher,
    first_prefetched,
    is_handled_in,
    record_run,
)
from tca_wire.journal.facts import Fact, HandlerRemoved, Queued, Recalling, Unqueued
from tca_wire.packets.large import held_size

QUEUE_LIMIT = 10_000
"""The most deliveries that may wait for one resource, or for one message that has no handler yet.

When a queue is full, further informs are dropped and further queries are refused. Tasks count, too,
but they are never refused, because they are in the tree anyway.
"""


Suspect = Delivery | ModuleClaim | tuple[Connection, int]
"""A wait that may close a cycle of waits.

A queued message waits for a slot. A connection with a request number waits for the answer to that
request. A granted claim whose handler has returned makes others wait for the claim's release.
"""


class Dispatcher(Stored):
    """Every delivery from its arrival until its handler has returned."""

    __slots__ = (
        "_arrivals",
        "_clock",
        "_facts",
        "_out",
        "_suspects",
        "are_tasks_paused",
        "bytes",
        "displaced",
        "granted",
        "handler_count",
        "lending",
        "old_serving_counts",
        "prefetcher",
        "running",
        "stranded",
        "to_refill",
        "waiting_for_busy_handler",
    )

    def __init__(
        self, facts: list[Fact], out: DispatchOutput, suspects: deque[Suspect], clock: Clock
    ) -> None:
        self._facts, self._out, self._suspects, self._clock = facts, out, suspects, clock
        self.prefetcher = Prefetcher(out, clock)
        self.lending = Lending()
        self._arrivals = 0
        self.are_tasks_paused = False  #: whether no task starts, after a restart
        self.running: dict[int, Delivery] = {}  #: by ``Delivery.handling_id``
        self.bytes = 0  #: bytes of all deliveries that are not tasks
        self.handler_count = 0  #: number of handlers of all messages
        #: By message whose number of serving handlers has changed: the number before.
        self.old_serving_counts: dict[MessageType, int] = {}
        self.to_refill: deque[tuple[Resource[Connection, Delivery], Connection | None]] = deque()
        """Resources that may admit a message or claim, each with the slot that became free or None.

        A slot is refilled last. Other consequences of its handler's end come first, because they
        may kill or hold the next message.
        """
        self.granted: deque[ModuleClaim] = deque()  #: claims just granted
        #: Queued tasks whose handler may have declared what happens to them while it is busy
        self.waiting_for_busy_handler: deque[Delivery] = deque()
        #: Deliveries that a pending limit has displaced, each with the reason as a text.
        self.displaced: deque[tuple[Delivery, str]] = deque()
        #: Exception handlers that wait although no module handles their message.
        self.stranded: deque[Delivery] = deque()

    def route(self, delivery: Delivery, *targets: ModuleResource) -> None:
        """Deliver a message, or queue it until a suitable slot is free.

        *targets* are the resources that may handle the message. By default these are the resources
        of the message's newest handler and of the others in that handler's pool.
        """
        if not delivery.arrival:
            self._arrive(delivery)
        resources = targets or delivery.message.candidates
        if self._assign_free_slot(delivery, resources):
            return
        slot = own_slot(delivery, resources)
        # While the resource is locked, a query of the slot's own handler waits in the queue. Other
        # messages before the query may wait for this very slot. So the resource remembers the
        # query. When the lock is released, ``refill_next`` has the slot handle the query.
        if slot is not None and slot.resource is not None and slot.resource.is_locked:
            slot.resource.locked_out_queries[delivery] = slot
            slot = None
        if slot is None:
            self._queue(delivery, resources)
            if delivery.message.custom_handlers and delivery.is_task:
                self.waiting_for_busy_handler.append(delivery)
        else:
            self._assign_nested(delivery, slot)

    def _assign_nested(self, delivery: Delivery, slot: Connection) -> None:
        """Have a slot handle a query whose answer the slot waits for, nested in this wait."""
        delivery.nested = True
        self._assign(delivery, slot)

    def lend(self, delivery: Delivery, slot: Connection) -> None:
        """Have a slot handle a queued delivery that its handler's wait needs, within this wait."""
        self._leave_queues(delivery)
        self._assign_nested(delivery, slot)

    def _queue(self, delivery: Delivery, resources: tuple[ModuleResource, ...]) -> None:
        """Put a delivery into the queues of its resources."""
        delivery.queues = resources
        if not delivery.is_task:
            self._count_queued(delivery, resources)
        delivery.since = self._clock.now
        if not resources:
            delivery.message.waiting[delivery.id] = delivery
            self._facts.append(_queued(delivery, "", ""))
            if delivery.is_stranded:
                self.stranded.append(delivery)
            return
        may_wait_for_ever = True
        for resource in resources:
            resource.queue(delivery)
            if resource.prefetched:
                self.prefetcher.recall_if_overtaken(resource, delivery)
            may_wait_for_ever = may_wait_for_ever and not _has_unblocked_slot(resource)
        self.lending.add(delivery, resources)
        if may_wait_for_ever:  # other deliveries are no suspects: a search is expensive
            self._suspects.append(delivery)
        first = resources[0]
        self._facts.append(_queued(delivery, first.module, first.name))
        self.prefetcher.fill(first)
        for resource in resources:
            if resource.limits and (limit := resource.limits.get(delivery.message.name)):
                self._apply_limit(limit, delivery, resource)

    def _count_queued(self, message: Delivery, resources: tuple[ModuleResource, ...]) -> None:
        """Count a queued message that is not a task.

        While tasks are paused after a restart, the message may overtake them. So its resources are
        refilled again.
        """
        self.bytes += DELIVERY_BYTES + held_size(message.body)
        if self.are_tasks_paused:
            self.to_refill.extend((resource, None) for resource in resources)

    def route_all(self, deliveries: Sequence[Delivery]) -> None:
        """Deliver or queue several messages.

        Free slots go to the messages of highest priority, and among equals to the first to arrive.
        All others are queued in the order of arrival.
        """
        if len(deliveries) > 1:
            for delivery in deliveries:
                self._arrive(delivery)
            unassigned = [
                delivery
                for delivery in sorted(deliveries, key=rank)
                if not self._assign_free_slot(delivery, delivery.message.candidates)
            ]
            deliveries = sorted(unassigned, key=attrgetter("arrival"))
        for delivery in deliveries:
            self.route(delivery)

    def _arrive(self, waiting: Delivery | ModuleClaim) -> None:
        """Number an arrival, once. Among equal priorities, the lowest number goes first."""
        if not waiting.arrival:
            self._arrivals += 1
            waiting.arrival = self._arrivals

    def _assign_free_slot(self, delivery: Delivery, resources: tuple[ModuleResource, ...]) -> bool:
        """Deliver to a free slot. Return False if there is none, or if tasks are paused."""
        if self.are_tasks_paused and delivery.is_task:
            return False
        for resource in resources:
            if slot := resource.slot_for(delivery):
                self._assign(delivery, slot)
                return True
        return False

    def _apply_limit(
        self, limit: PendingLimit[Delivery], newest: Delivery, resource: ModuleResource
    ) -> None:
        """Apply a pending limit: the delivery that has waited longest is displaced."""
        if (oldest := limit.add(newest)) is not None:
            self.withdraw(oldest)
            what, where = newest.message.name, resource.name
            why = f"at most {limit.most} of '{what}' may wait for '{where}', and a newer one came"
            self.displaced.append((oldest, why))

    def _assign(self, delivery: Delivery, slot: Connection, *, is_prefetched: bool = False) -> None:
        """Assign a delivery to a slot."""
        delivery.slot = slot
        self.running[delivery.handling_id] = delivery
        if not delivery.is_task:
            self.bytes += DELIVERY_BYTES + held_size(delivery.body)
        self._out.deliver(delivery, slot, is_prefetched=is_prefetched)
        if delivery.is_task:
            self.lending.add_below(delivery, slot.resource)

    def complete(self, delivery: Delivery, ended: float, took: float = 0.0) -> None:
        """Record that a handler has returned at *ended*.

        *took* is the handler's duration in seconds, by its module's own clock (0: unknown).
        """
        del self.running[delivery.handling_id]
        self.lending.postponed.pop(delivery, None)
        if not delivery.is_task:
            self.bytes -= DELIVERY_BYTES + held_size(delivery.body)
        slot, delivery.slot = delivery.slot, None
        assert slot is not None
        if slot.hang_timers:
            self._clock.cancel(slot.hang_timers.pop(delivery.handling_id, None))
        del slot.handling[delivery]
        slot.maybe_unstarted = None
        slot.acts_known_until = ended
        if delivery.nested:
            delivery.nested = False
            self.lending.to_lend.append(slot)
            if slot.resource is not None and slot.resource.waiting:
                self._suspects.extend((slot, number) for number in slot.waits)
        elif (resource := slot.resource) is not None:
            seconds = ended - delivery.since
            resource.busy += seconds
            record_run(resource, took or seconds)
            if not (slot.handling and self.lending.pass_on(slot)):
                self.to_refill.append((resource, slot))

    def postpone(self, delivery: Delivery, *, frees_slot: bool) -> None:
        """Record that a handler has returned, and replies later.

        With *frees_slot*, the delivery no longer counts for the capacity.
        """
        self.lending.postponed[delivery] = frees_slot
        slot = delivery.slot
        assert slot is not None
        self.lending.to_lend.append(slot)
        if frees_slot and not delivery.nested and slot.resource is not None:
            delivery.nested = True
            slot.resource.busy += self._clock.now - delivery.since
            if not (slot.handling and self.lending.pass_on(slot)):
                self.to_refill.append((slot.resource, slot))

    def refill_next(self) -> None:
        """Have the first resource of ``to_refill`` admit its next message or claim."""
        resource, slot = self.to_refill.popleft()
        if slot is not None and slot in resource.slots and slot.has_room:
            resource.free_slot(slot)
        following = self.next_in(resource)
        if isinstance(following, Claim):
            resource.grant(following)  # in all copies of its program, which have the resource too
            self.granted.append(following)
            self.to_refill.extend((copy, None) for copy in resource.copies)
        elif following is not None and resource.free:
            self._assign_next(following, resource)
            if resource.free or resource.locked_out_queries:
                self.to_refill.append((resource, None))
        elif resource.locked_out_queries and not resource.is_locked:
            # Each sender waits for the answer to its query, so it must handle the query itself.
            for delivery, sender in list(resource.locked_out_queries.items()):
                if sender in resource.slots:
                    self.lend(delivery, sender)
            resource.locked_out_queries.clear()

    def next_in(self, resource: Resource[Connection, Delivery]) -> Delivery | ModuleClaim | None:
        """Return the message or claim that a resource admits next; None if it admits nothing.

        While tasks are paused after a restart, a resource admits no task.
        """
        following = resource.next_queued()
        if self.are_tasks_paused and following is not None and following.is_task:
            return resource.next_non_task()
        return following

    def _assign_next(self, delivery: Delivery, resource: Resource[Connection, Delivery]) -> None:
        """Give a queued delivery to a free slot, and let the slot prefetch what follows."""
        slot = self._move_to_slot(delivery, resource)
        if slot.resource is not None and not delivery.is_task:
            self.prefetcher.fill(slot.resource)

    def _move_to_slot(
        self, delivery: Delivery, resource: Resource[Connection, Delivery]
    ) -> Connection:
        """Move a queued delivery to a free slot. Return the slot."""
        slot, is_prefetched = resource.acquire_slot(), delivery in resource.prefetched
        # Not empty if central has dropped the delivery, and its slot had begun it before.
        facts_of_drop = resource.prefetched.get(delivery) or ()
        self._leave_queues(delivery)
        self._assign(delivery, slot, is_prefetched=is_prefetched)
        self._facts.extend(facts_of_drop)
        return slot

    # --- prefetched messages: see prefetching.py --------------------------------------------------

    def begin_prefetched(self, slot: Connection, number: int) -> Delivery | None:
        """Record that a slot has begun its prefetched delivery *number*. Return the delivery.

        Returns None if the slot cannot have begun a delivery of that number. A slot begins a
        prefetched delivery without asking central. The first sign may be its handler's request.
        """
        resource, first = slot.resource, first_prefetched(slot)
        if first is None or first.handling_id != number or resource is None or not slot.has_room:
            return None
        # Usually the slot's last handler has just returned, so the slot is last in ``to_refill``.
        if self.to_refill and self.to_refill[-1] == (resource, slot):
            self.to_refill.pop()
        resource.free_slot(slot)
        self._move_to_slot(first, resource)
        return first

    def _remove_prefetched(self, slot: Connection, resource: ModuleResource) -> list[Delivery]:
        """Remove the prefetched deliveries of a disconnected slot from their queue.

        Returns those that central has not dropped in the meantime.
        """
        found = []
        for delivery in list(resource.prefetched) if resource.prefetching_slot is slot else ():
            facts_of_drop = resource.requeue_prefetched(delivery)
            self.withdraw(delivery, keep_place=True, facts_of_drop=facts_of_drop or ())
            if facts_of_drop is None:
                found.append(delivery)
        return found

    def _end_recall(self, resource: ModuleResource) -> None:
        """Record that a recall is over, if one is in progress."""
        if resource.is_recalling:
            resource.is_recalling = False
            self._facts.append(Recalling(resource.module, resource.name, is_over=True))

    def requeue_returned(
        self, slot: Connection, unbegun: Iterable[int], *, is_answer: bool
    ) -> list[Delivery]:
        """Put the prefetched deliveries with the numbers *unbegun* back into the queue.

        With *is_answer*, the slot answers a recall: it has begun its other prefetched deliveries.
        Returns the deliveries that belong in another queue by now. They are then in no queue.
        """
        resource = slot.resource
        if resource is None or resource.prefetching_slot is not slot:
            return []
        numbers = set(unbegun)
        returned = [
            (delivery, resource.requeue_prefetched(delivery))
            for delivery in list(resource.prefetched)
            if delivery.handling_id in numbers
        ]
        moved = []
        for delivery, facts_of_drop in returned:
            if facts_of_drop is not None:
                self.withdraw(delivery, facts_of_drop=facts_of_drop)
            elif not is_handled_in(resource, delivery, slot.module):
                moved.append(delivery)
        for delivery in moved:
            self.withdraw(delivery, keep_place=True)
        if not is_answer:
            # The slot has returned them without a recall. Central may have sent it more since then.
            self.prefetcher.recall(resource)
        else:
            was_recalling, resource.is_recalling = resource.is_recalling, False
            if (begun := first_prefetched(slot)) is not None and resource.is_free(slot):
                self._assign_next(begun, resource)
            if was_recalling:  # in the journal, the message above begins before the recall ends
                self._facts.append(Recalling(resource.module, resource.name, is_over=True))
        self.to_refill.append((resource, None))
        return moved

    def release_tasks(self, modules: Iterable[Module]) -> None:
        """Let tasks start again after a restart."""
        self.are_tasks_paused = False
        for resource in (one for module in modules for one in module.resources.values()):
            self._admit_more(resource)
            self._suspects.extend((one, number) for one in resource.slots for number in one.waits)

    def _admit_more(self, resource: Resource[Connection, Delivery]) -> None:
        """Have a resource admit what was kept out: in free slots, and within waits."""
        self.to_refill.append((resource, None))
        self.lending.to_lend.extend(dict.fromkeys(resource.lendable.values()))
        self._suspects.extend(resource.lendable)

    # --- claims -----------------------------------------------------------------------------------

    def claim(self, claim: ModuleClaim) -> None:
        """Queue a claim."""
        self._arrive(claim)
        claim.since = self._clock.now
        claim.resource.add_claim(claim)
        for resource in claim.resource.copies:
            self.prefetcher.recall_if_overtaken(resource, claim)
        self.to_refill.append((claim.resource, None))

    def end_claim(self, claim: ModuleClaim) -> None:
        """End a claim that was given up or released."""
        claim.resource.end_claim(claim)
        for copy in claim.resource.copies:
            self._admit_more(copy)

    def withdraw(
        self, delivery: Delivery, *, keep_place: bool = False, facts_of_drop: tuple[Fact, ...] = ()
    ) -> None:
        """Remove a delivery from its queues, if it is in any.

        With *keep_place* the delivery keeps its place in line for the next time. *facts_of_drop*
        are recorded now. For a prefetched delivery they are recorded later, when central learns
        whether the slot has returned or begun the delivery.
        """
        if delivery.queues is None or self.prefetcher.revoke(delivery, facts_of_drop):
            return
        if delivery.queues == ():
            del delivery.message.waiting[delivery.id]
        if not keep_place:
            delivery.arrival = 0
        self._facts.append(Unqueued(delivery.handling_id))
        self._leave_queues(delivery)
        self._facts.extend(facts_of_drop)

    def _leave_queues(self, delivery: Delivery) -> None:
        """Remove a delivery from its queues. A claim behind the delivery may be next now."""
        for resource in delivery.queues or ():
            if resource.claims or self.are_tasks_paused:
                self.to_refill.append((resource, None))
        if not delivery.is_task:
            self.bytes -= DELIVERY_BYTES + held_size(delivery.body)
        delivery.withdraw()

    @staticmethod
    def is_full(message: MessageType, *targets: ModuleResource) -> bool:
        """Whether the queues for a message of this type are full. With *targets*, only theirs."""
        if not targets and not message.handlers:
            return len(message.waiting) >= QUEUE_LIMIT
        for resource in targets or message.candidates:  # noqa: SIM110 - all() costs twice as much
            if resource.waiting < QUEUE_LIMIT:
                return False
        return True

    # --- slots and handlers -----------------------------------------------------------------------

    def add_slot(self, slot: Connection, resource: ModuleResource) -> None:
        """Add a connection that handles messages for a resource."""
        slot.resource = resource
        if not resource.capacity:
            self._change_serving_of_slot(slot, +1)
        resource.add_slot(slot)
        self.prefetcher.recall(resource)  # the new slot may handle some of them
        self.to_refill.append((resource, slot))

    def remove_slot(self, slot: Connection) -> list[Delivery]:
        """Remove a disconnected slot. Return its deliveries: those begun, then those prefetched.

        A nested delivery comes after the delivery whose handler waits for it.
        """
        prefetched: list[Delivery] = []
        if slot.resource is not None:
            prefetched = self._remove_prefetched(slot, slot.resource)
            if slot is slot.resource.prefetching_slot:
                self._end_recall(slot.resource)
            slot.resource.remove_slot(slot)
            self.to_refill.append((slot.resource, None))  # a claim may have waited for this slot
            if not slot.resource.capacity:
                self._change_serving_of_slot(slot, -1)
        for timer in slot.hang_timers.values():
            self._clock.cancel(timer)
        slot.hang_timers.clear()
        orphans, slot.handling, slot.maybe_unstarted = list(slot.handling), {}, None
        for delivery in orphans:
            del self.running[delivery.handling_id]
            self.lending.postponed.pop(delivery, None)
            if not delivery.is_task:
                self.bytes -= DELIVERY_BYTES + held_size(delivery.body)
            if slot.resource is not None and not delivery.nested:
                slot.resource.busy += self._clock.now - delivery.since
            delivery.slot, delivery.nested = None, False
        return orphans + prefetched

    def _change_serving_of_slot(self, slot: Connection, change: int) -> None:
        """Adjust the number of serving handlers for all messages that a slot's resource handles."""
        for handler in slot.module.handlers.values():
            if handler.resource is slot.resource:
                self._change_serving(handler.message, change)

    def _change_serving(self, message: MessageType, change: int) -> None:
        """Adjust a message's number of serving handlers: those whose resource has a slot."""
        self.old_serving_counts.setdefault(message, message.serving)
        message.serving += change

    def add_handler(self, handler: Handler) -> None:
        """Add a handler. It takes over the waiting deliveries of its message."""
        message = handler.message
        queued = [] if message.fans_out else self._remove_queued(message)
        message.add_handler(handler)
        self.handler_count += 1
        if handler.resource.capacity:
            self._change_serving(message, +1)
        if handler.pending:
            handler.resource.limits[message.name] = PendingLimit(handler.pending)
        handler.module.handlers[message.name] = handler
        self.route_all(queued)

    def remove_handlers(self, handlers: list[Handler]) -> list[Delivery]:
        """Remove handlers. Return the deliveries that waited for them and are now in no queue."""
        return [delivery for handler in handlers for delivery in self._remove_handler(handler)]

    def _remove_handler(self, handler: Handler) -> list[Delivery]:
        """Remove one handler. Return the deliveries that waited for it."""
        message = handler.message
        self.prefetcher.recall(handler.resource)
        queued = self._remove_queued(message, handler.resource)
        message.remove_handler(handler)
        self.handler_count -= 1
        if handler.resource.capacity:
            self._change_serving(message, -1)
        handler.resource.limits.pop(message.name, None)
        del handler.module.handlers[message.name]
        self._facts.append(HandlerRemoved(message.name, handler.module.name))
        return queued

    def list_stranded(self, messages: Iterable[MessageType]) -> None:
        """Fill ``stranded`` with the waiting tasks of *messages* that are exception handlers.

        No module handles such a task any more.
        """
        waiting = (
            one for message in messages for one in message.waiting.values() if one.is_stranded
        )
        self.stranded.clear()
        self.stranded.extend(sorted(waiting, key=lambda one: one.arrival))

    def _remove_queued(
        self, message: MessageType, only: ModuleResource | None = None
    ) -> list[Delivery]:
        """Remove the waiting deliveries of a message (for one resource *only*) from their queues.

        Returns the removed deliveries, oldest first. Prefetched deliveries stay in their queues.
        """
        resources = [only] if only else _resources(message)
        prefetched = {one for resource in resources for one in resource.prefetched}
        queued = [one for one in self.queued(message, only) if one not in prefetched]
        message.waiting.clear()
        for delivery in queued:
            self._leave_queues(delivery)
        return queued

    @staticmethod
    def queued(message: MessageType, only: ModuleResource | None = None) -> list[Delivery]:
        """Return the waiting deliveries of a message (for one resource *only*), oldest first."""
        resources = [only] if only else _resources(message)
        in_queues = (one for resource in resources for one in resource.queued())
        found = {one.id: one for one in in_queues if one.message is message}
        found.update(message.waiting)
        return sorted(found.values(), key=attrgetter("arrival"))


def _resources(message: MessageType) -> list[ModuleResource]:
    """Return the resources in which a message is handled."""
    return list({handler.resource: None for handler in message.handlers})


def _queued(delivery: Delivery, module: str, resource: str) -> Queued:
    """Return the fact that a delivery was queued."""
    return Queued(delivery.handling_id, delivery.message_id, module, resource, delivery.priority)


def _has_unblocked_slot(resource: ModuleResource) -> bool:
    """Whether a slot of a resource is free, or has a handler that waits for nothing.

    Then a delivery for this resource is in no deadlock. The same is true of a resource without
    slots, because a slot may be added at any time. Return False if the resource has a claim.
    """
    if resource.held_by is not None or resource.claims:
        return False
    for slot in resource.slots:  # any() costs twice as much
        if not slot.waits:
            return True
    return not resource.slots
