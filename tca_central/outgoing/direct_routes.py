"""Routes for messages that go from module to module directly (TCA 8.5: direct connections).

Central gives a *route*, the entrances of the slots that may be sent a message, to whoever sends
such a message through central; as long as that is so, it tells them of every change. A message has
a route if its newest handler wants it and nothing has to see it on its way: no wiretap, no pending
limit, no lock, no other handler that shares it. What has been told is only a licence: a sender may
use central at any time, and does until it has reached an entrance.
"""

import math
from collections.abc import Iterable

from tca_central.errors import RequestError, check_name
from tca_central.model.deliveries import Connection, Delivery, MessageType, ModuleResource
from tca_central.model.resources import Resource
from tca_central.model.rights import MOST_LICENCES
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.packets.headers import Hello
from tca_wire.packets.licences import licence
from tca_wire.packets.parts import HandlerFormat
from tca_wire.packets.routes import (
    MOST_LOST,
    MOST_NOTES,
    Barred,
    Entrance,
    EntranceGone,
    Note,
    Noted,
    Route,
    WatchEntrance,
)
from tca_wire.vocabulary import LONGEST_TIME, Limit, MessageClass, Outcome, Permission, Refusal


def check_entrance(entrance: Entrance) -> None:
    """Raises RequestError if modules can't be sent there."""
    is_address = (
        entrance.endpoint.startswith(("ipc://", "tcp://")) and entrance.endpoint.isprintable()
    )
    if (
        not is_address
        or max(map(len, (entrance.endpoint, entrance.key, entrance.curve))) > 2 * Limit.NAME
    ):
        text = f"{entrance.endpoint!r:.60} is not an entrance: give an ipc:// or tcp:// address"
        raise RequestError(Refusal.PROTOCOL, text)


def own_entrance(central: State, header: Hello) -> Entrance | None:
    """The entrance that a new slot names, unless that is another one's: when this slot went, they
    would be told that the other one had.
    """
    wanted = header.entrance
    if wanted is None:
        return None
    others = (
        one.entrance for one in central.registry.connections.values() if one.entrance is not None
    )
    return None if any(other.endpoint == wanted.endpoint for other in others) else wanted


def check_handler(handled: HandlerFormat, message_class: MessageClass) -> None:
    """Raises RequestError if messages of that class can't be handled so."""
    # Tasks belong into the tree, and other messages go to many.
    if handled.direct and (message_class.is_task or message_class.fans_out):
        text = f"{message_class} '{handled.message}' can't be sent directly: only informs and queries can"
        raise RequestError(Refusal.PROTOCOL, text)


# --- routes ---------------------------------------------------------------------------------------


def route_of(message: MessageType) -> tuple[Connection, ...]:
    """The slots that may be sent a message directly; none if it has to go through central."""
    if not message.handlers or message.taps:
        return ()
    newest = message.handlers[-1]
    if newest.resource.held_by is not None or newest.resource.claims:
        return ()
    if not newest.direct or newest.pending or len(message.candidates) > 1:
        return ()
    slots = tuple(newest.resource.slots)
    return slots if all(slot.entrance is not None for slot in slots) else ()


def review(central: State, messages: Iterable[MessageType]) -> None:
    """The handlers, slots or wiretaps of messages have changed: whoever knows their routes learns
    the new ones.
    """
    for message in messages:
        if (route := route_of(message)) != message.route:
            message.route = route
            for connection in list(message.senders_told):
                _say_route(central, connection, message)


def review_slots(central: State, slot: Connection) -> None:
    """A slot of a resource has come or gone."""
    handlers = slot.module.handlers.values()
    review(central, [handler.message for handler in handlers if handler.resource is slot.resource])


def review_copies(central: State, resource: Resource[Connection, Delivery]) -> None:
    """Review the slots of all copies of a resource: a claim on it has come or gone."""
    for copy in resource.copies:
        if (slot := next(iter(copy.slots), None)) is not None:
            review_slots(central, slot)


def tell_sender(central: State, connection: Connection, message: MessageType) -> None:
    """A connection has sent a message through central that has a route: it may do without central
    from now on.
    """
    if connection not in message.senders_told:
        message.senders_told[connection] = None
        connection.routes[message] = None
        _say_route(central, connection, message)


def _say_route(central: State, connection: Connection, message: MessageType) -> None:
    route = message.route
    if connection.resource is not None and any(
        slot.resource is connection.resource for slot in route
    ):
        route = ()  # a resource handles its own query inside its wait: that needs central
    if not all(_may_reach(connection, slot) for slot in route):
        route = ()
    for slot in route:
        _watch(connection, slot)
    entrances = [
        _licensed(central, connection, slot.entrance) for slot in route if slot.entrance is not None
    ]
    central.tell(connection, Route(message.name, entrances))


def _watch(connection: Connection, slot: Connection) -> None:
    slot.watchers[connection] = None
    connection.watches[slot] = None


def forget_sender(connection: Connection) -> None:
    """Forget the routes of a connection that is gone, or may have missed some."""
    for message in connection.routes:
        del message.senders_told[connection]
    for slot in connection.watches:
        slot.watchers.pop(connection, None)
    connection.routes.clear()
    connection.watches.clear()


# --- licences -------------------------------------------------------------------------------------


def _may_reach(connection: Connection, slot: Connection) -> bool:
    """Whether it may send all that a slot takes directly: the slot does not ask which of that."""
    rights, handlers = connection.rights, slot.module.handlers.values()
    taken = [one.message.name for one in handlers if one.direct and one.resource is slot.resource]
    return rights is None or all(rights.allow(Permission.SEND, name) for name in taken)


def _licensed(central: State, connection: Connection, entrance: Entrance) -> Entrance:
    """An entrance as a sender gets it."""
    permissions = central.registry.permissions
    if not connection.licence:
        connection.licence = permissions.new_licence(connection.principal)
        if len(permissions.licences) > MOST_LICENCES:
            bar(central, [next(iter(permissions.licences))], anew=False)
    key = licence(entrance.key, _number(central, connection.licence))
    return Entrance(entrance.endpoint, key, entrance.curve)


def _number(central: State, number: int) -> str:
    return f"{central.epoch}.{number}"


def bar(central: State, numbers: list[int], *, anew: bool = True) -> None:
    """These licences are not valid any more. Who is connected, and may still send directly, gets
    another one *anew*.
    """
    if not numbers:
        return
    central.registry.permissions.bar(numbers)
    barred = dict.fromkeys(numbers)
    connections = list(central.registry.connections.values())
    for slot in connections:
        if slot.entrance is not None:
            central.tell(slot, Barred([_number(central, number) for number in numbers]))
    for sender in connections:
        if sender.licence in barred:
            sender.licence = 0
            for message in list(sender.routes) if anew else ():
                _say_route(central, sender, message)


def tell_barred(central: State, slot: Connection) -> None:
    """A slot may not have heard which licences are not valid any more."""
    if slot.entrance is not None and (barred := central.registry.permissions.barred):
        central.tell(slot, Barred([_number(central, number) for number in barred]))


def bar_owners(central: State, principals: Iterable[str]) -> None:
    """The keys of these are revoked; their connections end next, and get nothing more."""
    gone = dict.fromkeys(principals)
    numbers = [
        number for number, owner in central.registry.permissions.licences.items() if owner in gone
    ]
    bar(central, numbers, anew=False)


def review_licences(central: State) -> None:
    """Permissions have changed: only those keep their licences who are here, and may still send all
    they reach.
    """
    kept = {
        one.licence: None
        for one in central.registry.connections.values()
        if one.licence and all(_may_reach(one, slot) for slot in one.watches)
    }
    bar(central, [number for number in central.registry.permissions.licences if number not in kept])


# --- entrances ------------------------------------------------------------------------------------


def tell_slot_gone(central: State, slot: Connection, why: str, *, lost: bool) -> None:
    """A slot is gone, and its routes have been reviewed: who may have sent it queries learns that
    it answers none.
    """
    if slot.entrance is not None:
        gone = EntranceGone(
            slot.entrance.endpoint, f"module '{slot.module.name}' was lost: {why}", lost
        )
        for connection in slot.watchers:
            del connection.watches[slot]
            central.tell(connection, gone)
        slot.watchers.clear()


def on_watch_entrance(
    central: State, connection: Connection, header: WatchEntrance, _: bytes
) -> None:
    """A sender comes back that has queries open at an entrance."""
    # seldom: once for each entrance after a break
    for slot in central.registry.connections.values():
        if slot.entrance is not None and slot.entrance.endpoint == header.endpoint:
            _watch(connection, slot)
            return
    central.tell(connection, EntranceGone(header.endpoint, "the module was lost meanwhile"))


# --- outcomes of direct messages ------------------------------------------------------------------


def _check_noted(header: Noted) -> None:
    """Raises RequestError if a report says what can't be."""
    if len(header.notes) + len(header.losses) > 2 * MOST_NOTES:
        raise RequestError(
            Refusal.OVERLOAD, f"more than {2 * MOST_NOTES} notes in one report: send several"
        )
    for note in header.notes:
        if not _is_time(note.ago) or not _is_time(note.seconds):
            raise RequestError(
                Refusal.PROTOCOL, f"a note of '{note.message:.60}' has times below 0 or too long"
            )
        if note.size < 0:
            raise RequestError(
                Refusal.PROTOCOL, f"a note of '{note.message:.60}' has {note.size} bytes of data"
            )
        check_name("message", note.message)
        check_name("module", note.sender)
        check_name("failure", note.failure, or_none=True)
    for loss in header.losses:
        check_name("message", loss.message, or_none=True)
        if not 0 <= loss.number <= MOST_LOST:
            raise RequestError(
                Refusal.PROTOCOL, f"{loss.number} lost '{loss.message}': at most {MOST_LOST:,}"
            )


def on_noted(central: State, connection: Connection, header: Noted, _: bytes) -> None:
    """A connection reports; the journal has it."""
    _check_noted(header)
    module, resource = (
        connection.module.name,
        connection.resource.name if connection.resource else "",
    )
    for note in header.notes:
        ended = max(0.0, central.clock.now - note.ago)
        fact = facts.HandledDirectly(
            note.message,
            module,
            resource,
            note.sender,
            note.origin,
            note.size,
            ended,
            note.seconds,
            note.outcome,
            note.failure,
        )
        central.facts.append(fact)
        _count(central, connection.resource, note)
    for loss in header.losses:
        central.facts.append(facts.LostDirectly(module, loss.message, loss.number))
        if (message := central.registry.messages.get(loss.message)) is not None:
            message.dropped += loss.number


def _count(central: State, resource: ModuleResource | None, note: Note) -> None:
    """A direct message counts like one that central delivered."""
    has_failed = note.outcome is Outcome.FAILED
    if (message := central.registry.messages.get(note.message)) is not None:
        message.delivered += 1
        message.failed += has_failed
    if resource is not None:
        resource.delivered += 1
        resource.busy += note.seconds


def _is_time(seconds: float) -> bool:
    return math.isfinite(seconds) and 0 <= seconds <= LONGEST_TIME
