"""Forgets declared messages that are no longer needed, to make room for new ones.

The number of names is limited, and formats take memory.
"""

from collections.abc import Iterable, Iterator

from tca_central.errors import RequestError
from tca_central.model import registry
from tca_central.model.deliveries import MessageType
from tca_central.model.tasks import Task
from tca_central.state import Collector, State, drop
from tca_wire.journal import facts
from tca_wire.vocabulary import Dropping, Refusal

AT_ONCE = 1000
"""The least number of messages that a search forgets, if as many are unused.

Searches are expensive, so each makes much room.
"""

STEPS = 50
"""The delay after a search that found little: one event for each STEPS objects that it checked."""


def make_room(central: State, new: list[str], size: int, needed: Iterable[str]) -> None:
    """Forget unused messages to make room for new names and *size* more bytes.

    Names in *needed* stay. Raises RequestError if there is too little room afterwards.
    """
    known = central.registry
    if _fits(central, new, size):
        return
    if central.event_count >= known.next_search:
        _forget_unused(central, new, size, set(needed))
    if (over := len(known.messages) + len(new) - registry.MESSAGES) > 0:
        text = f"{registry.MESSAGES} messages have been declared: '{new[-over]}' is too many"
        central.budget.refused += 1
        raise RequestError(Refusal.OVERLOAD, text)
    central.check_declared(size)


def _fits(central: State, new: list[str], size: int) -> bool:
    """Whether new names and bytes fit into the limits."""
    if len(central.registry.messages) + len(new) > registry.MESSAGES:
        return False
    return central.declared_bytes + size <= central.budget.declared


def _forget_unused(central: State, new: list[str], size: int, needed: set[str]) -> None:
    """Forget messages that are not in use.

    After a search that found little, the next one is delayed.
    """
    steps, known = 0, central.registry
    used: dict[MessageType, None] = {}
    for message in _used(central):
        used[message] = None
        steps += 1
    needed.update(one for message in used for one in message.format.needs)
    unused = [one for one in known.messages.values() if one not in used and one.name not in needed]
    values = central.variables.values
    # First come messages without a value, those with the fewest waiting informs first. Among equals
    # the oldest comes first.
    unused.sort(key=lambda one: (one.name in values, len(one.waiting)))
    freed = 0
    for message in unused:
        if (freed >= AT_ONCE or message.name in values) and _fits(central, new, size):
            break
        freed += 1 + len(message.waiting)
        _forget(central, message)
    if len(unused) < AT_ONCE:
        known.next_search = central.event_count + (steps + len(known.messages)) // STEPS


def _forget(central: State, message: MessageType) -> None:
    """Forget a message, its value, and the informs that wait for a handler of it."""
    if (value := central.variables.values.get(message.name)) is not None:
        central.variables.forget(message.name)
        why = "no module declares it any more, and its place was needed"
        central.facts.append(facts.Dropped(value.message_id, message.name, why))
    for inform in list(message.waiting.values()):
        central.dispatcher.withdraw(inform)
        why = "it has no handler, its module has left, and room was needed for other names"
        drop(central, inform, why, Dropping.OVERLOAD)
        central.budget.refused += 1
    central.registry.forget_message(message)


def _used(central: State) -> Iterator[MessageType]:
    """Yield the messages that are in use: declared, handled, awaited, on their way, or attached.

    A message is not in use if only informs without a handler wait.
    """
    for message in central.registry.messages.values():
        if (
            message.declarers
            or message.handlers
            or message.awaited_by
            or message.attached
            or message.taps
        ):
            yield message
        if message.waiting and (message.message_class.is_task or message.message_class.has_reply):
            yield message
    for module in central.registry.modules.values():
        for resource in module.resources.values():
            yield from (delivery.message for delivery in resource.queued())
    yield from (delivery.message for delivery in central.dispatcher.running.values())
    for connection in central.registry.connections.values():
        yield from (
            due.message for due in connection.outstanding.values() if isinstance(due, Collector)
        )
    for task in central.tree.tasks.values():
        yield from _used_by(task)
    yield from (record.message for record in central.memory.records.values())
    yield from (attached.handler for attached in central.attached.values())
    yield from (tap.listener for tap in central.taps.values())


def _used_by(task: Task) -> Iterator[MessageType]:
    """Yield the messages that a task refers to."""
    yield task.message
    if task.scheduled is not None:
        yield from (message for message, _ in task.scheduled.termination_messages)
    yield from (tap.listener for tap in task.taps)
