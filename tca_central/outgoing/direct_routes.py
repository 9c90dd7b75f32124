"""Routes for messages that modules send each other directly (TCA 8.5: direct connections).

An *entrance* is the address of a slot for direct messages. A *route* is the set of entrances of the
slots that may get a message directly. A module that sends such a message through central gets the
route, and from then on every change of the route. A message has a route if its newest handler wants
direct messages and nothing requires central. A wiretap, a pending limit, a lock, or another handler
in a pool requires central.

A route is only a permission: a sender may use central at any time, and does so until it has reached
an entrance. Each route contains a *licence*, which proves to the slots that the sender may send.
Central revokes the licence when the sender loses its rights.
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
    """Raise RequestError if modules can't send messages to that address."""
    endpoint = entrance.endpoint
    is_address = endpoint.startswith(("ipc://", "tcp://")) and endpoint.isprintable()
    if not is_address or max(map(len, (endpoint, entrance.key, entrance.curve))) > 2 * Limit.NAME:
        text = f"{endpoint!r:.60} is not an entrance: give an ipc:// or tcp:// address"
        raise RequestError(Refusal.PROTOCOL, text)


def own_entrance(central: State, header: Hello) -> Entrance | None:
    """Return the entrance that a new slot names; None if it names none.

    The entrance of another slot counts as none. Otherwise the loss of one slot would be reported to
    senders as the loss of the other.
    """
    wanted = header.entrance
    return None if wanted is None or _slot_at(central, wanted.endpoint) is not None else wanted


def _slot_at(central: State, endpoint: str) -> Connection | None:
    """Return the slot with that entrance, or None."""
    for slot in central.registry.connections.values():
        if slot.entrance is not None and slot.entrance.endpoint == endpoint:
            return slot
    return None


def check_handler(handled: HandlerFormat, message_class: MessageClass) -> None:
    """Raise RequestError if a handler wants direct messages of a class that can't be direct."""
    # Central needs tasks for the tree, and distributes messages with several receivers.
    if handled.direct and (message_class.is_task or message_class.fans_out):
        what = f"{message_class} '{handled.message}'"
        text = f"{what} can't be sent directly: only informs and queries can"
        raise RequestError(Refusal.PROTOCOL, text)


# --- routes ---------------------------------------------------------------------------------------


def route_of(message: MessageType) -> tuple[Connection, ...]:
    """Return the slots that may get a message directly; none if the message has to pass central."""
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
    """Send changed routes to senders, after handlers, slots, claims or wiretaps have changed."""
    for message in messages:
        if (route := route_of(message)) != message.route:
            message.route = route
            for connection in list(message.informed_senders):
                _send_route(central, connection, message)


def review_slots(central: State, slot: Connection) -> None:
    """Review the routes of a resource's messages after a slot was added or removed."""
    handlers = slot.module.handlers.values()
    review(central, [handler.message for handler in handlers if handler.resource is slot.resource])


def review_copies(central: State, resource: Resource[Connection, Delivery]) -> None:
    """Review the routes of all copies of a resource after a claim on it was made or ended."""
    for copy in resource.copies:
        if (slot := next(iter(copy.slots), None)) is not None:
            review_slots(central, slot)


def offer_route(central: State, connection: Connection, message: MessageType) -> None:
    """Send a message's route to a sender of the message, unless the sender has the route."""
    if connection not in message.informed_senders:
        message.informed_senders[connection] = None
        connection.routes[message] = None
        _send_route(central, connection, message)


def _send_route(central: State, connection: Connection, message: MessageType) -> None:
    """Send a message's route to a connection, with the connection's licence.

    The route is empty if the connection must send the message through central.
    """
    own, route = connection.resource, message.route
    # A slot that waits must handle queries from its own resource: these need central.
    if any(own is slot.resource or not _may_reach(connection, slot) for slot in route):
        route = ()
    for slot in route:
        _watch(connection, slot)
    entrances = [
        _licensed(central, connection, slot.entrance) for slot in route if slot.entrance is not None
    ]
    central.notify(connection, Route(message.name, entrances))


def _watch(connection: Connection, slot: Connection) -> None:
    """Have a sender notified of the end of a slot."""
    slot.watchers[connection] = None
    connection.watches[slot] = None


def forget_sender(connection: Connection) -> None:
    """Forget the routes of a connection that is closed, or may have missed changes."""
    for message in connection.routes:
        del message.informed_senders[connection]
    for slot in connection.watches:
        slot.watchers.pop(connection, None)
    connection.routes.clear()
    connection.watches.clear()


# --- licences -------------------------------------------------------------------------------------


def _may_reach(connection: Connection, slot: Connection) -> bool:
    """Whether a connection may send every message that a slot accepts directly.

    It must have the right to all of them, because slots check no rights.
    """
    rights, handlers = connection.rights, slot.module.handlers.values()
    names = [one.message.name for one in handlers if one.direct and one.resource is slot.resource]
    return rights is None or all(rights.allow(Permission.SEND, name) for name in names)


def _licensed(central: State, connection: Connection, entrance: Entrance) -> Entrance:
    """Return *entrance* with a sender's licence as its key. Give the sender one if it has none."""
    permissions = central.registry.permissions
    if not connection.licence:
        connection.licence = permissions.new_licence(connection.principal)
        if len(permissions.licences) > MOST_LICENCES:
            bar(central, [next(iter(permissions.licences))], renew=False)
    key = licence(entrance.key, _licence_name(central, connection.licence))
    return Entrance(entrance.endpoint, key, entrance.curve)


def _licence_name(central: State, number: int) -> str:
    """Return the name by which slots know a licence."""
    return f"{central.epoch}.{number}"


def bar(central: State, numbers: list[int], *, renew: bool = True) -> None:
    """Invalidate licences. With *renew*, connected senders get new ones for their routes."""
    if not numbers:
        return
    central.registry.permissions.bar(numbers)
    barred = dict.fromkeys(numbers)
    connections = list(central.registry.connections.values())
    for slot in connections:
        if slot.entrance is not None:
            central.notify(slot, Barred([_licence_name(central, number) for number in numbers]))
    for sender in connections:
        if sender.licence in barred:
            sender.licence = 0
            for message in list(sender.routes) if renew else ():
                _send_route(central, sender, message)


def send_invalid_licences(central: State, slot: Connection) -> None:
    """Send a slot all invalid licences, since it may have missed some."""
    if slot.entrance is not None and (barred := central.registry.permissions.barred):
        central.notify(slot, Barred([_licence_name(central, number) for number in barred]))


def invalidate_licences_of(central: State, principals: Iterable[str]) -> None:
    """Invalidate the licences of revoked keys. Their connections end next: none is renewed."""
    revoked = dict.fromkeys(principals)
    numbers = [
        number
        for number, owner in central.registry.permissions.licences.items()
        if owner in revoked
    ]
    bar(central, numbers, renew=False)


def review_licences(central: State) -> None:
    """Invalidate the licences of senders that left or may no longer use all their routes."""
    kept = {
        one.licence: None
        for one in central.registry.connections.values()
        if one.licence and all(_may_reach(one, slot) for slot in one.watches)
    }
    bar(central, [number for number in central.registry.permissions.licences if number not in kept])


# --- entrances ------------------------------------------------------------------------------------


def report_closed_slot(central: State, slot: Connection, why: str, *, lost: bool) -> None:
    """Report a closed slot to the senders that may have sent queries to it.

    Call ``review_slots`` first.
    """
    if slot.entrance is not None:
        notice = EntranceGone(
            slot.entrance.endpoint, f"module '{slot.module.name}' was lost: {why}", lost
        )
        for connection in slot.watchers:
            del connection.watches[slot]
            central.notify(connection, notice)
        slot.watchers.clear()


def on_watch_entrance(
    central: State, connection: Connection, header: WatchEntrance, _: bytes
) -> None:
    """Have a reconnected sender notified when a slot ends to which it has sent queries."""
    # This search is slow, but rare: once per entrance after a reconnect.
    if (slot := _slot_at(central, header.endpoint)) is not None:
        _watch(connection, slot)
    else:
        why = "the module was lost in the meantime"
        central.notify(connection, EntranceGone(header.endpoint, why))


# --- outcomes of direct messages ------------------------------------------------------------------


def _check_noted(header: Noted) -> None:
    """Raise RequestError for impossible values in a report."""
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
    """Record direct messages, which a connection reports, in the journal."""
    _check_noted(header)
    module = connection.module.name
    resource = connection.resource.name if connection.resource else ""
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
    """Count a direct message like one that central delivered."""
    if (message := central.registry.messages.get(note.message)) is not None:
        message.delivered += 1
        message.failed += note.outcome is Outcome.FAILED
    if resource is not None:
        resource.delivered += 1
        resource.busy += note.seconds


def _is_time(seconds: float) -> bool:
    """Whether a module's number of seconds is a possible duration."""
    return math.isfinite(seconds) and 0 <= seconds <= LONGEST_TIME
