"""How busy everything is, and who waits longest: what ``tca top`` shows. Changes nothing.

Numbers go up from the beginning of the run (a resource's, of its module's): who asks twice learns the rates. Times are
seconds of central's clock.
"""

import heapq
from collections.abc import Iterable, Iterator
from itertools import islice
from operator import itemgetter
from typing import Any

from tca_central.model.registry import Connection, Delivery, MessageType, Module, ModuleResource
from tca_central.model.task_tree import Task
from tca_central.state import State
from tca_central.status.whereabouts import awaited, held_at, held_by, kept_busy, named

SHOWN_WAITS = 50
LOOKED_AT = 10_000
"""Living tasks, the oldest, among which those that are held are looked for and counted: nothing need be noted of it."""

Waiting = tuple[float, str, str, str]
"""Since when, who, what for, and what keeps that busy ("": nothing does)."""


def load(central: State) -> dict[str, Any]:
    """Numbers of everything, and the longest waits, the longest first: at most SHOWN_WAITS of each kind, with how many
    there are ("totals"; of held tasks, among the oldest "looked_at").
    """
    now, registry = central.clock.now, central.registry
    waits, held, suspended = list(_waits(central)), _held(central), _suspended(central)
    return {
        "epoch": central.epoch,
        "time": now,
        "events": central.events,
        "connections": len(registry.connections),
        "tasks": len(central.tree.tasks),
        "modules": [_module(module, now) for module in registry.modules.values()],
        "messages": [_message(message) for message in registry.messages.values()],
        "waits": [
            {"what": what, "for": why, "busy": busy, "seconds": max(now - since, 0.0)}
            for since, what, why, busy in heapq.nsmallest(SHOWN_WAITS, waits, key=itemgetter(0))
        ],
        "held": [
            _of_task(task, now - since) | {"for": held_by(central, task, at)}
            for since, _, task, at in heapq.nsmallest(SHOWN_WAITS, held)
        ],
        "suspended": [_of_task(task, now - since) | {"by": by} for since, by, task in suspended[:SHOWN_WAITS]],
        "killed": _killed(central),
        "totals": {"waits": len(waits), "held": len(held), "suspended": len(suspended)},
        "looked_at": min(len(central.tree.tasks), LOOKED_AT),
    }


def _of_task(task: Task, seconds: float) -> dict[str, Any]:
    return {"task": int(task.id), "what": named(task), "seconds": max(seconds, 0.0)}


def _module(module: Module, now: float) -> dict[str, Any]:
    resources = [_resource(resource, now) for resource in module.resources.values()]
    return {"module": module.name, "process": module.process, "resources": resources}


def _message(message: MessageType) -> dict[str, Any]:
    return {
        "message": message.name,
        "class": str(message.message_class),
        "delivered": message.delivered,
        "failed": message.failed,
        "waiting": len(message.waiting),
    }


def _resource(resource: ModuleResource, now: float) -> dict[str, Any]:
    inside = [(one, slot) for slot in resource.slots for one in slot.handling]
    first = _oldest(resource.queued())
    held_by = resource.held_by
    return {
        "resource": resource.name,
        "capacity": resource.capacity,
        "handling": [{"id": one.id, "message": one.message.name, "seconds": now - one.since} for one, _ in inside],
        "blocked": sum(bool(slot.waits or slot.pauses) for slot in resource.slots),
        "waiting": resource.waiting,
        "oldest": now - first.since if first else 0.0,
        "delivered": resource.delivered,
        "busy": resource.busy + sum(now - one.since for one, _ in inside if not one.nested),
        "held_by": held_by.slot.module.name if held_by else "",
        "is_reserved": bool(held_by and held_by.admits_owner),
        "claims": len(resource.claims),
    }


def _oldest(waiting: Iterable[Delivery]) -> Delivery | None:
    """Which has waited longest."""
    return min(waiting, key=lambda one: one.since, default=None)


def _waits(central: State) -> Iterator[Waiting]:
    """The oldest message in each queue, those that wait for a handler, claims, and handlers that wait."""
    for module in central.registry.modules.values():
        for resource in module.resources.values():
            first = _oldest(resource.queued())
            where, busy = f"resource '{resource.name}' of '{module.name}'", kept_busy(resource, is_now=True)
            if first is not None:
                more = f" (and {resource.waiting - 1} more)" if resource.waiting > 1 else ""
                yield first.since, f"{named(first)}{more}", where, busy
            for claim in resource.claims:
                yield claim.since, f"a claim of '{claim.slot.module.name}'", where, busy
    for message in central.registry.messages.values():
        first = next(iter(message.waiting.values()), None)
        if first is not None:
            more = f" (and {len(message.waiting) - 1} more)" if len(message.waiting) > 1 else ""
            yield first.since, f"{named(first)}{more}", "a module that handles it", ""
    connections = central.registry.connections.values()
    for connection in (one for one in connections if one.waits or one.pauses):
        for number, wait in (*connection.waits.items(), *connection.pauses.items()):
            handled = central.dispatcher.attended.get(wait.origin)
            inside = f" in {named(handled)}" if handled is not None else ""
            yield wait.at, f"'{connection.module.name}'{inside}", awaited(central, connection, number), ""


def _held(central: State) -> list[tuple[float, int, Task, int]]:
    """Tasks that constraints hold back: since when (they were sent or last handled), and which beginning."""
    oldest = islice(central.tree.tasks.values(), LOOKED_AT)
    held = (task for task in oldest if task.held and task.slot is None and task.queues is None and not task.killed)
    return [(task.since, number, task, at) for number, task in enumerate(held) if (at := held_at(task))]


def _suspended(central: State) -> list[tuple[float, str, Task]]:
    """The topmost suspended tasks (what is under them is, too), since when and by whom, the longest first."""
    tasks = central.tree.tasks
    noted = ((*how, tasks[number]) for number, how in islice(central.tree.suspended.items(), LOOKED_AT))
    return [(since, by, task) for since, by, task in noted if task.parent is None or not task.parent.suspended]


def _killed(central: State) -> list[dict[str, Any]]:
    """Killed tasks whose handler still runs, in which module, and what it waits for as far as central knows."""
    attended = central.dispatcher.attended.values()
    return [
        {"task": int(one.id), "what": named(one), "why": one.killed, "module": one.slot.module.name,
         "for": _awaited_in(central, one.slot, one)}
        for one in attended if isinstance(one, Task) and one.killed and one.slot is not None
    ]  # fmt: skip


def _awaited_in(central: State, slot: Connection, handled: Delivery) -> str:
    """What the handler of a delivery waits for; "" if it does not, or central does not know."""
    mine = handled.given_as
    blocking = [number for each in (slot.waits, slot.pauses) for number, wait in each.items() if wait.origin == mine]
    asked = [number for number, due in slot.outstanding.items() if getattr(due, "origin", mine) == mine]
    newest = (blocking or asked)[-1:]
    return awaited(central, slot, newest[0]) if newest else ""
