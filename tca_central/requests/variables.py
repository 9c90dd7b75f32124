"""Sets, reads and exchanges variables (TCA 7.7: SetVar, GetVar, GetSetVar, WatchVar).

A variable is a message of a class of its own, and its handlers watch it. A handler gets each new
value. If several values wait for a handler, it gets only the newest. A variable without handlers
keeps its value for later handlers.
"""

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection, Delivery, Handler, MessageType
from tca_central.model.registry import Value
from tca_central.outgoing.central_messages import copy_of, received
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.messages.formats import first_difference
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer
from tca_wire.packets.large import held_size
from tca_wire.points import ROOT
from tca_wire.vocabulary import Refusal

NEVER_SET = b""
"""The body that stands for no value; values are never empty."""


def _variable(central: State, name: str) -> MessageType:
    """Return the variable of that name. Raise RequestError if there is none."""
    message = central.registry.messages.get(name)
    if message is None:
        raise RequestError(
            Refusal.UNKNOWN, f"no module has declared variable '{name}': register it first"
        )
    if not message.message_class.keeps_value:
        raise RequestError(
            Refusal.PROTOCOL, f"'{name}' is of class {message.message_class}, not a variable"
        )
    return message


def _value(central: State, message: MessageType) -> bytes:
    """Return a variable's value, or NEVER_SET."""
    known = central.variables.values.get(message.name)
    return known.body if known else NEVER_SET


def on_get_variable(
    central: State, connection: Connection, header: headers.GetVariable, _: bytes
) -> None:
    """Answer with a variable's value.

    The answer is not stored: a repeated request gets the newest value.
    """
    central.notify(
        connection, Answer(header.number), _value(central, _variable(central, header.variable))
    )


def on_set_variable(
    central: State, connection: Connection, header: headers.SetVariable, body: bytes
) -> None:
    """Set a variable. The answer to an exchange is the previous value."""
    message = _variable(central, header.variable)
    if header.swap and not header.number:
        raise RequestError(
            Refusal.PROTOCOL, f"an exchange of variable '{message.name}' needs a request number"
        )
    if body == NEVER_SET:
        raise RequestError(
            Refusal.PROTOCOL, f"variable '{message.name}' can't be set to nothing: give a value"
        )
    central.check_tap_depth(message)
    central.variables.check_room(message.name, body, central.budget.variables)
    central.check_room(held_size(body) * len(message.handlers))
    before = _value(central, message)
    delivery = Delivery(central.new_id(), message, body, connection)
    delivery.origin, delivery.tap_depth = header.origin, central.tap_depth
    sender = connection.module.name
    central.facts.append(received(delivery, sender, ROOT, [], header.origin))
    central.variables.set(message.name, Value(body, message.format.data, sender, delivery.id))
    # A handler without slots is included: it gets the newest value when it has a slot.
    for handler in message.handlers:
        central.dispatcher.route(copy_of(central, delivery), handler.resource)
    if header.swap:
        central.answer(connection, header.number, Answer(header.number), before)
    elif header.number:
        central.accept(connection, header.number, delivery.id)


def send_value_to_watcher(central: State, handler: Handler) -> None:
    """Send a new handler the value of its variable, if the variable has one."""
    message = handler.message
    if message.message_class.keeps_value and (value := central.variables.values.get(message.name)):
        copy = Delivery(central.new_id(), message, value.body, None)
        copy.message_id = value.message_id
        central.dispatcher.route(copy, handler.resource)


def forget_unfit_value(central: State, message: MessageType) -> None:
    """Forget the value of a variable that was declared again with another format."""
    value = central.variables.values.get(message.name)
    if value is not None and first_difference(value.format, message.format.data):
        central.variables.forget(message.name)
        why = "its variable was declared again with another format"
        central.facts.append(facts.Dropped(value.message_id, message.name, why))
