"""Lending: a slot whose handler waits handles, within this wait, a task that the wait needs.

Without that a handler could not wait for a subtask of its own resource. The lent slot stays in one
thread: the newest delivery runs, and the others wait for its end. A handler that has returned, and
replies later, leaves its slot to the tasks below it, too.

This module knows which queued tasks stand below the deliveries of which slot. It does not decide
what a wait needs (requests/waiting.py).
"""

from collections import deque

from tca_central.model.deliveries import Connection, Delivery, ModuleResource
from tca_central.model.resources import rank
from tca_central.model.stored import Stored
from tca_central.model.tasks import Task

MOST_IN_SLOT = 20
"""The most deliveries that one slot has at a time. Each handler uses the stack of one thread."""

_MOST_COMPARED = 1000
"""The most queued tasks that are compared with a wait. A search for deadlocks finds the others."""


class Lending(Stored):
    """The slots that may be lent, and the deliveries whose handlers reply later."""

    __slots__ = ("postponed", "to_lend")

    def __init__(self) -> None:
        #: By delivery whose handler has returned, and replies later: whether its slot is free.
        self.postponed: dict[Delivery, bool] = {}
        self.to_lend: deque[Connection] = deque()
        """Slots that may have become able to handle a task below one of their deliveries.

        Like a free slot, they get it last: other consequences may kill it, hold it or precede it.
        """

    def add(self, queued: Delivery, resources: tuple[ModuleResource, ...]) -> None:
        """Note a queued task at the slot of *resources* that handles its nearest such ancestor."""
        # Most slots handle no task with subtasks: then a deep tree is not walked.
        if not isinstance(queued, Task) or not any(map(_handles_parents, resources)):
            return
        for above in queued.lineage():
            slot = above.slot
            if slot is not None and slot.resource in resources:
                slot.resource.lendable[queued] = slot
                if slot.outstanding or above in self.postponed:
                    self.to_lend.append(slot)
                return

    def add_below(self, begun: Delivery, resource: ModuleResource | None) -> None:
        """Note the tasks that wait for a resource below a task that one of its slots begins."""
        if isinstance(begun, Task) and begun.children and resource is not None:
            for queued in resource.queued():
                if isinstance(queued, Task) and queued.find_above(begun.id) is not None:
                    self.add(queued, queued.queues or ())

    def pass_on(self, slot: Connection) -> bool:
        """Give a slot to its newest message that still needs it. Return False without one.

        A coroutine, or a handler that replies later, may end before a task within its wait does.
        """
        for delivery in reversed(slot.handling):
            if not self.postponed.get(delivery):
                delivery.nested = False
                self.to_lend.append(slot)
                return True
        return False

    def handler_in(self, slot: Connection) -> Delivery | None:
        """Return the newest delivery of a slot whose handler has not returned; None without one."""
        return next((one for one in reversed(slot.handling) if one not in self.postponed), None)

    def waits_of(self, slot: Connection) -> list[int]:
        """Return the requests whose answers hold back the newest handler of a slot, if any."""
        handler = self.handler_in(slot)
        return [
            number
            for number, wait in (*slot.waits.items(), *slot.unchecked_waits.items())
            if handler is not None and wait.origin == handler.handling_id
        ]

    @staticmethod
    def task_to_lend(slot: Connection, awaited: set[int] | None) -> Task | None:
        """Return the first queued task below a delivery of a slot that may go to the slot.

        With *awaited*, the task is one of these tasks, or stands below one.
        """
        resource = slot.resource
        if resource is None or not resource.lendable or not may_be_lent(slot, resource):
            return None
        found: Task | None = None
        compared = 0
        for task, owner in resource.lendable.items():
            if owner is not slot or not isinstance(task, Task):
                continue
            if awaited is not None:
                compared += 1
                if compared > _MOST_COMPARED:
                    break
                if not any(task.find_above(number) is not None for number in awaited):
                    continue
            if not any(above.slot is slot for above in task.lineage()):
                continue  # the slot has done with the task's ancestor
            if found is None or rank(task) < rank(found):
                found = task
        return found


def _handles_parents(resource: ModuleResource) -> bool:
    """Whether a slot of a resource handles a task that has living subtasks."""
    return any(
        isinstance(one, Task) and one.children for slot in resource.slots for one in slot.handling
    )


def may_be_lent(slot: Connection, resource: ModuleResource, most: float = MOST_IN_SLOT) -> bool:
    """Whether a slot of a resource may handle one more delivery in the wait of its handler."""
    is_busy = slot in resource.slots and not resource.is_free(slot)
    return is_busy and not resource.is_locked and len(slot.handling) < most


def own_slot(delivery: Delivery, resources: tuple[ModuleResource, ...]) -> Connection | None:
    """Return the sender of a query if it is a slot of one of *resources*; else None.

    Such a slot blocks for the answer, so it must handle the query itself, nested in its wait. The
    query ignores capacity and reservations, because otherwise the slot would wait for itself.
    """
    sender = delivery.sender
    if (
        not delivery.message.message_class.has_reply
        or sender is None
        or sender.resource is None
        or sender not in sender.resource.slots
    ):
        return None
    return sender if sender.resource in resources else None
