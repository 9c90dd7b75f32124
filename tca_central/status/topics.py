"""Central's answers about itself: one function per topic, returning plain values."""

import itertools
from collections.abc import Iterable
from typing import Any

import msgspec

from tca_central.errors import RequestError
from tca_central.model.deliveries import (
    Connection,
    Handler,
    Holder,
    MessageType,
    Module,
    ModuleResource,
)
from tca_central.model.registry import Value
from tca_central.model.tasks import Task, TaskRecord, place_of
from tca_central.order.holds import held_counts
from tca_central.state import State
from tca_central.status.load import load
from tca_wire.packets import codec, headers
from tca_wire.packets.headers import Answer
from tca_wire.packets.large import held_size
from tca_wire.points import ALL_MOMENTS, ROOT, Moment, describe_moments
from tca_wire.vocabulary import CENTRAL, Limit, Outcome, Refusal

SHOWN_TASKS = 10_000
SHOWN_SENT = 10
SHOWN_BYTES = 512
"""The longest value of a variable that is shown."""


def overview(central: State) -> dict[str, Any]:
    """Return counts of everything."""
    registry = central.registry
    restart_pause: dict[str, Any] = {}
    if central.dispatcher.are_tasks_paused:
        restart_pause = {
            "awaited": sorted({one.module.name for one in central.restart_pause.awaited}),
            "to be told": central.restart_pause.until_resumed,
        }
    return (
        restart_pause
        | _members(central)
        | {
            "epoch": central.epoch,
            "events": central.event_count,
            "modules": len(registry.modules),
            "connections": len(registry.connections),
            "messages": len(registry.messages),
            "variables": len(central.variables.values),
            "tasks": len(central.tree.tasks),
            "kept tasks": len(central.memory.records),
            "exception handlers": len(central.attached),
            "wiretaps": len(central.taps),
            "being handled": len(central.dispatcher.running),
            "waiting for a handler": sum(
                len(message.waiting) for message in registry.messages.values()
            ),
            "dropped": registry.dropped
            + sum(message.dropped for message in registry.messages.values()),
            "forgotten answers": central.answers.forgotten,
            "newest id": central.tree.newest,
        }
    )


def _members(central: State) -> dict[str, Any]:
    """Return the centrals with the same replicated log, if there is one."""
    if (members := central.members) is None:
        return {}
    standbys = [msgspec.structs.asdict(one) for one in members.standbys]
    shown = {"leader": members.leader, "address": members.address, "standbys": standbys}
    return {"members": shown}


def modules(central: State) -> list[dict[str, Any]]:
    """Return each module with its resources and their load."""
    return [
        {
            "module": module.name,
            "process": module.process,
            "handles": sorted(module.handlers),
            "resources": [_resource(resource) for resource in module.resources.values()],
        }
        for module in central.registry.modules.values()
    ]


def _resource(resource: ModuleResource) -> dict[str, Any]:
    owner = resource.held_by.slot.module.name if resource.held_by is not None else ""
    return {
        "resource": resource.name,
        "capacity": resource.capacity,
        "handling": sorted(delivery.id for slot in resource.slots for delivery in slot.handling),
        "waiting": resource.waiting,
        "replaced": resource.replaced,
        "locked_by": owner if resource.is_locked else "",
        "reserved_by": "" if resource.is_locked else owner,
        "claims": len(resource.claims),
    }


def messages(central: State) -> list[dict[str, Any]]:
    """Return each message: its class, its handlers (newest first), how many wait, its formats."""
    return [
        {
            "message": message.name,
            "class": str(message.message_class),
            "handlers": _modules(message)[::-1],
            "handled_by": [_handler(handler) for handler in reversed(message.handlers)],
            "awaited_by": [wait.connection.module.name for wait in message.awaited_by],
            "waiting": len(message.waiting),
            "data": message.format.data,
            "reply": message.format.reply,
            "progress": message.format.progress,
            "life_cycle": message.format.life_cycle,
            "retry": message.format.retry,
        }
        for message in central.registry.messages.values()
    ]


def _modules(message: MessageType) -> list[str]:
    """Return the modules that handle a message, newest last."""
    return [handler.module.name for handler in message.handlers]


def _handler(handler: Handler) -> dict[str, Any]:
    resource = handler.resource
    return {
        "module": handler.module.name,
        "resource": resource.name,
        "pool": handler.pool,
        "pending": handler.pending,
        "capacity": resource.capacity,
        "waiting": resource.waiting,
    }


def tree(central: State) -> list[dict[str, Any]]:
    """Return the living tasks, parents first, at most SHOWN_TASKS."""
    tasks = itertools.islice(central.tree.subtree(central.tree.root), 1, 1 + SHOWN_TASKS)
    return [describe(task) for task in tasks]


def describe(task: Task | TaskRecord) -> dict[str, Any]:
    """Return a living or retained task in plain values."""
    return {
        "task": int(task.id),
        "parent": int(task.parent.id) if task.parent else 0,
        "message": task.message.name,
        "class": str(task.message.message_class),
        "role": str(task.role),
        **(_ended(task) if isinstance(task, TaskRecord) else _living(task)),
    }


def _living(task: Task) -> dict[str, Any]:
    """Return the progress of a living task."""
    return {
        "reached": describe_moments(task.reached),
        "held": {
            describe_moments(Moment(moment))[0]: count
            for moment, count in held_counts(task).items()
        },
        "module": task.slot.module.name if task.slot else "",
        "suspended": task.suspended,
        "killed": task.killed,
        "failure": task.failure[0] if task.failure else "",
        "outcome": "",
    }


def _ended(task: TaskRecord) -> dict[str, Any]:
    """Return the end of a retained task, in the fields of ``_living``."""
    outcome, failure, text, _ = task.outcome
    return {
        "reached": describe_moments(ALL_MOMENTS),
        "held": {},
        "module": "",
        "suspended": False,
        "killed": text if outcome is Outcome.KILLED else "",
        "failure": failure,
        "outcome": str(outcome),
    }


def relatives(
    central: State, task: Task | TaskRecord | None, relation: str, message: str
) -> list[dict[str, Any]]:
    """Return the relatives of a task with their data, nearest or oldest first.

    Only tasks of *message* are returned ("": of all messages).
    """
    if task is None:
        return []
    living = task if isinstance(task, Task) else None
    related: dict[str, Iterable[Task | TaskRecord | None]] = {
        "self": (task,),
        "parent": (task.parent,),
        "children": (living.children or {}).values() if living else (),
        "ancestors": itertools.islice(task.lineage(), 1, None),
        "descendants": itertools.islice(central.tree.subtree(living), 1, None) if living else (),
        "kept": task.retention.records.values() if task.retention is not None else (),
    }
    wanted = (
        one
        for one in related[relation]
        if one is not None and one.id and message in ("", one.message.name)
    )
    return [
        {
            **describe(one),
            "data": one.body,
            "result": one.outcome[3] if isinstance(one, TaskRecord) else b"",
        }
        for one in itertools.islice(wanted, SHOWN_TASKS)
    ]


def variables(central: State) -> list[dict[str, Any]]:
    """Return each variable: its value as MessagePack (empty if long), its setter, its watchers."""
    found = []
    for message in central.registry.messages.values():
        if not message.message_class.keeps_value:
            continue
        value = central.variables.values.get(message.name) or Value(b"", "", "", 0)
        variable = {
            "variable": message.name,
            "value": value.body if len(value.body) <= SHOWN_BYTES else b"",
            "bytes": held_size(value.body),
            "set_by": value.set_by,
            "message": value.message_id,
            "watched_by": _modules(message),
            "data": message.format.data,
        }
        found.append(variable)
    return found


def attached(central: State) -> dict[str, Any]:
    """Return the exception handlers, wiretaps and monitors in force, at most SHOWN_TASKS of each.

    Each list has the oldest first, except for retried monitors, which are last. "totals" counts
    all, beyond SHOWN_TASKS too. A "task" of 0 without a "message" is the root; a "failure" of "" is
    any.
    """
    ready = central.registry.ready_programs()
    handlers = [
        {
            "id": one.id,
            "failure": one.failure,
            "handler": one.handler.name,
            **_place(place_of(one)),
            "maximum": one.maximum,
            **_holders(central, one.holders.values(), place_of(one), ready),
            "handled_by": _modules(one.handler),
        }
        for one in itertools.islice(central.attached.values(), SHOWN_TASKS)
    ]
    wiretaps = [
        {
            "id": tap.id,
            "condition": str(tap.condition),
            "listener": tap.listener.name,
            **_place(place_of(tap)),
            **_holders(central, tap.holders.values(), place_of(tap), ready),
            "handled_by": _modules(tap.listener),
            "is_monitor": tap.listener.message_class.is_monitor,
        }
        for tap in itertools.islice(central.taps.values(), SHOWN_TASKS)
    ]
    watches = itertools.islice(central.watches.values(), SHOWN_TASKS)
    monitors = [_monitor(central, watch.task, ready) for watch in watches]
    totals = {
        "exception_handlers": len(central.attached),
        "wiretaps": len(central.taps),
        "monitors": len(central.watches),
    }
    return {
        "exception_handlers": handlers,
        "wiretaps": wiretaps,
        "monitors": monitors,
        "totals": totals,
    }


def _monitor(central: State, task: Task, ready: set[str]) -> dict[str, Any]:
    place = task.parent or central.tree.root
    senders = [task.sender.module.holder] if task.sender else []
    holders = _holders(central, senders, place, ready)
    return {
        "id": int(task.id),
        "monitor": task.message.name,
        **_place(place),
        **holders,
        "modules": holders["modules"] or [CENTRAL],
    }


def _holders(
    central: State, holders: Iterable[Holder], place: Task | MessageType, ready: set[str]
) -> dict[str, Any]:
    """Return the modules that attached something.

    *ready* are the programs with a run that has made the attachments of its start. "gone" are
    modules that have left. "earlier" are modules whose program is ready in a later run, but has not
    attached the thing again. An attachment "is_stale" if all its modules are earlier. An attachment
    to a task is never stale: it ends with the task.
    """
    holders, runs = list(holders), central.registry.modules
    rejoined = ready - {one.called for one in holders if one.run in runs}
    lasts = place is central.tree.root or isinstance(place, MessageType)
    return {
        "modules": [one.name for one in holders],
        "gone": [one.name for one in holders if one.run not in runs and one.called not in rejoined],
        "earlier": [one.name for one in holders if one.called in rejoined],
        "is_stale": lasts and bool(holders) and all(one.called in rejoined for one in holders),
    }


def _place(place: Task | MessageType) -> dict[str, Any]:
    """Return the place of an attachment: a task with its message (root: none), or a message."""
    if isinstance(place, MessageType):
        return {"task": 0, "message": place.name}
    return {"task": int(place.id), "message": place.message.name if place.id else ""}


def _sent(central: State, module: Module) -> dict[str, Any]:
    """Return the first top-level tasks of a module that are not killed, and how many there are."""
    sent = central.tree.top_of_module.get(module, {}).values()
    tasks = [task for task in sent if not task.killed]
    return {"tasks": [str(task) for task in tasks[:SHOWN_SENT]], "total": len(tasks)}


TOPICS = {
    "status": overview,
    "modules": modules,
    "messages": messages,
    "tree": tree,
    "variables": variables,
    "load": load,
    "attached": attached,
}
"""One row per topic that modules can ask for."""


# --- requests -------------------------------------------------------------------------------------


def on_ask(central: State, connection: Connection, header: headers.Ask, _: bytes) -> None:
    """Answer a module's question about a topic."""
    if header.topic == "sent":
        found: Any = _sent(central, connection.module)
    else:
        found = TOPICS[header.topic](central)
    _answer(central, connection, header.number, found, f"the answer to '{header.topic}'")


def on_inspect(central: State, connection: Connection, header: headers.Inspect, _: bytes) -> None:
    """Answer a module's question about a task and its relatives."""
    living = central.tree.root if header.task == ROOT else central.tree.task(header.task)
    task = living or central.memory.records.get(header.task)
    found = relatives(central, task, header.relation, header.message)
    what = f"the {header.relation} of task {{{header.task}}}"
    _answer(central, connection, header.number, found, what)


def _answer(central: State, connection: Connection, number: int, value: Any, what: str) -> None:
    """Answer with a value. Raise RequestError if it is too long; *what* names it in the error."""
    body = codec.encode(value)
    if len(body) > Limit.BODY:
        raise RequestError(Refusal.OVERLOAD, f"{what} has {len(body)} bytes: read the journal")
    central.answer(connection, number, Answer(number), body)
