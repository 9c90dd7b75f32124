"""The load and the longest waits, for ``tca status`` and ``tca top``. This changes no state.

Counts start at 0 with the run, those of a resource with its module. The difference of two answers
gives a rate. Times are seconds of central's clock.
"""

import heapq
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
from operator import attrgetter, itemgetter
from typing import Any

from tca_central.model.deliveries import Connection, Delivery, MessageType, Module, ModuleResource
from tca_central.model.tasks import Task
from tca_central.needs.graph import Granting, Node, Returning, Turn, TurnAt, Waiting
from tca_central.needs.waits import Ends, next_of, waits_of
from tca_central.order.holds import has_held_start
from tca_central.state import State
from tca_wire.points import ROOT, START_HANDLING
from tca_wire.waits import CommonEnd, Waiter, WaitFor, WaitKind

SHOWN_WAITS = 50
"""Waits of each kind in an answer."""
LOOKED_AT = 10_000
"""Held tasks are searched among this number of the oldest tasks, to limit the cost of an answer."""
_EDGES = 10_000
"""Edges of the graph of needs to visit at most, in search of the final causes of waits."""
_SHOWN_ENDS = 10
"""Final causes of waits in an answer."""

_AGE_ORDER = attrgetter("since", "arrival")
"""The sort key of waiting messages: the start of the wait, then the rank in the queue."""

_Wait = tuple[float, Callable[[], Waiter]]
"""The start of a wait, and a function that describes the wait. Only shown waits are described."""


def load(central: State) -> dict[str, Any]:
    """Return counts of everything and the longest waits, SHOWN_WAITS of a kind.

    "ends" has the final causes for which most held tasks wait.
    """
    registry = central.registry
    waits, held, suspended = list(_waits(central)), _held(central), _suspended(central)
    ends = Ends(central, _EDGES)
    common = Counter(end for task in held if (end := ends.end_of(next_of(task))) is not None)
    return {
        "epoch": central.epoch,
        "time": central.clock.now,
        "events": central.event_count,
        "connections": len(registry.connections),
        "tasks": len(central.tree.tasks),
        "modules": [_module(module, central.clock.now) for module in registry.modules.values()],
        "messages": [_message(message) for message in registry.messages.values()],
        "waits": [
            describe() for _, describe in heapq.nsmallest(SHOWN_WAITS, waits, key=itemgetter(0))
        ],
        "held": [_held_task(central, task, ends) for task in held[:SHOWN_WAITS]],
        "suspended": suspended[:SHOWN_WAITS],
        "killed": _killed(central),
        "ends": [CommonEnd(number, end) for end, number in common.most_common(_SHOWN_ENDS)],
        "totals": {"waits": len(waits), "held": len(held), "suspended": len(suspended)},
        "memory": _memory(central),
        "overloads": central.budget.refused,
        "looked_at": min(len(central.tree.tasks), LOOKED_AT),
    }


def _memory(central: State) -> dict[str, tuple[int, int]]:
    """Return the bytes that each part of the budget holds, and may hold.

    Bytes that were sent but not read are missing: the server counts them.
    """
    budget = central.budget
    return {
        "messages and tasks": (central.message_bytes, budget.messages),
        "declarations and waits": (central.declared_bytes, budget.declared),
        "answers": (central.answers.bytes, budget.answers),
        "outcomes": (central.memory.outcome_bytes, budget.outcomes),
        "kept tasks": (central.memory.record_bytes, budget.records),
        "variables": (central.variables.bytes, budget.variables),
    }


def _module(module: Module, now: float) -> dict[str, Any]:
    resources = [_resource(resource, now) for resource in module.resources.values()]
    return {"module": module.name, "process": module.process, "resources": resources}


def _message(message: MessageType) -> dict[str, Any]:
    return {
        "message": message.name,
        "class": str(message.message_class),
        "delivered": message.delivered,
        "failed": message.failed,
        "dropped": message.dropped,
        "waiting": len(message.waiting),
    }


def _resource(resource: ModuleResource, now: float) -> dict[str, Any]:
    handled = [one for slot in resource.slots for one in slot.handling]
    oldest = min(resource.queued(), key=_AGE_ORDER, default=None)
    held_by = resource.held_by
    return {
        "resource": resource.name,
        "capacity": resource.capacity,
        "handling": [_handled(one, now) for one in handled],
        "blocked": sum(bool(slot.waits or slot.unchecked_waits) for slot in resource.slots),
        "waiting": resource.waiting,
        "oldest": now - oldest.since if oldest else 0.0,
        "delivered": resource.delivered,
        "busy": resource.busy + sum(now - one.since for one in handled if not one.nested),
        "held_by": held_by.slot.module.name if held_by else "",
        "is_reserved": bool(held_by and held_by.admits_owner),
        "claims": len(resource.claims),
    }


def _handled(one: Delivery, now: float) -> dict[str, Any]:
    """Return a handled message; for a task also its state, unless that is the usual one."""
    state = one.state if isinstance(one, Task) and one.state != one.message.running_state else ""
    return {"id": one.id, "message": one.message.name, "state": state, "seconds": now - one.since}


def _waits(central: State) -> Iterator[_Wait]:
    """Yield the wait of each queue's oldest message; the waits of handlers, clients and claims."""
    for module in central.registry.modules.values():
        for resource in module.resources.values():
            if (oldest := min(resource.queued(), key=_AGE_ORDER, default=None)) is not None:
                yield _queued(central, oldest, TurnAt(oldest, resource), resource.waiting - 1)
    for message in central.registry.messages.values():
        for oldest in islice(message.waiting.values(), 1):
            yield _queued(central, oldest, Turn(oldest), len(message.waiting) - 1)
    for connection in central.registry.connections.values():
        for number, wait in (*connection.waits.items(), *connection.unchecked_waits.items()):
            yield _blocking(central, connection, wait.origin, Waiting(connection, number), wait.at)
    yield from _claims(central)


def _claims(central: State) -> Iterator[_Wait]:
    """Yield the waits of claims for which no handler or client blocks."""
    for (connection, number), claim in central.claims.items():
        if not (
            claim.is_granted or number in connection.waits or number in connection.unchecked_waits
        ):
            origin = claim.holder.handling_id if claim.holder is not None else 0
            yield _blocking(central, connection, origin, Granting(claim), claim.since)


def _queued(central: State, oldest: Delivery, node: Node, more: int) -> _Wait:
    """Return the wait of a queue's oldest message; *more* messages wait behind it."""
    name, seconds = oldest.message.name, central.clock.now - oldest.since
    return oldest.since, lambda: Waiter(
        oldest.message_id, name, more=more, seconds=seconds, waits=tuple(waits_of(central, node))
    )


def _blocking(
    central: State, connection: Connection, origin: int, node: Node, since: float
) -> _Wait:
    """Return the wait of the handler of delivery *origin*, or (0) of a client."""
    handled, seconds = central.dispatcher.running.get(origin), central.clock.now - since
    number, name = (handled.message_id, handled.message.name) if handled is not None else (0, "")
    module = connection.module.name
    return since, lambda: Waiter(
        number, name, module, seconds=seconds, waits=tuple(waits_of(central, node))
    )


def _held(central: State) -> list[Task]:
    """Return tasks that constraints or a suspended parent hold, and monitors that a parent awaits.

    The longest held come first.
    """
    held = [
        one
        for one in islice(central.tree.tasks.values(), LOOKED_AT)
        if _is_held(one) and one.slot is None and one.queues is None and not one.killed
    ]
    return sorted(held, key=_AGE_ORDER)


def _is_held(task: Task) -> bool:
    """Whether a task waits for a constraint or its parent, or is a monitor that a parent awaits."""
    parent = task.parent
    if task.suspended and parent is not None:
        # The topmost suspended tasks are listed by ``_suspended``.
        return parent.suspended and (has_held_start(task) or not task.reached & START_HANDLING)
    if task.message.is_interval_monitor and task.reached & START_HANDLING and not task.returned:
        return not task.is_background and parent is not None and parent.id != ROOT
    return has_held_start(task) or (task.returned and bool(task.held))


def _held_task(central: State, task: Task, ends: Ends) -> Waiter:
    """Return a held task with its waits. Add their final cause if it is not among the waits."""
    waits, end = tuple(waits_of(central, next_of(task))), ends.end_of(next_of(task))
    return _waiter(central, task, task.since, waits, None if end in waits else end)


def _waiter(
    central: State, task: Task, since: float, waits: tuple[WaitFor, ...], end: WaitFor | None = None
) -> Waiter:
    """Return a task that has waited *since* that time."""
    seconds = max(central.clock.now - since, 0.0)
    return Waiter(
        task.id, task.message.name, seconds=seconds, killed=task.killed, waits=waits, end=end
    )


def _suspended(central: State) -> list[Waiter]:
    """Return the topmost suspended tasks, the longest suspended first."""
    suspended = (
        (central.tree.tasks[number], *suspension)
        for number, suspension in islice(central.tree.suspended.items(), LOOKED_AT)
    )
    return [
        _waiter(
            central,
            task,
            since,
            (WaitFor(WaitKind.RESUME, module=by, seconds=since, since_birth=since_birth),),
        )
        for task, since, by, since_birth in suspended
        if task.parent is None or not task.parent.suspended
    ]


def _killed(central: State) -> list[Waiter]:
    """Return the killed tasks whose handlers still run, with the handlers' known waits."""
    return [
        _waiter(central, one, one.since, (_handler_of(central, one, one.slot),))
        for one in central.dispatcher.running.values()
        if isinstance(one, Task) and one.killed and one.slot is not None
    ]


def _handler_of(central: State, task: Task, slot: Connection) -> WaitFor:
    """Return the wait for the end of a task's handler.

    The causes of this wait are the waits of the handler or, without one, its last open request.
    """
    because = tuple(waits_of(central, Returning(task)))
    requests = [
        number
        for number, due in slot.outstanding.items()
        if getattr(due, "origin", task.handling_id) == task.handling_id
    ]
    if not because and requests:
        because = tuple(waits_of(central, Waiting(slot, requests[-1])))
    return WaitFor(WaitKind.RUNNING, module=slot.module.name, because=because)
