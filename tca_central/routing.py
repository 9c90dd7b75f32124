"""How statements (informs and broadcasts) are routed once they exist: to one handler, or a copy to each."""

from tca_central.registry import Delivery, ModuleResource
from tca_central.state import State
from tca_wire import facts
from tca_wire.headers import MessageClass


def route_statement(central: State, original: Delivery) -> None:
    """Send an inform on its way to its handler, or a broadcast to every handler."""
    if original.message.message_class is MessageClass.INFORM:
        route_or_drop(central, original)
        return
    copied = copies(central, original)
    for copy, resource in copied:
        route_or_drop(central, copy, resource)
    if not copied:
        central.facts.append(facts.Dropped(original.id, "nobody listens"))


def route_or_drop(central: State, delivery: Delivery, *targets: ModuleResource) -> None:
    """Send a delivery on its way, unless too much waits there already."""
    if central.dispatcher.is_full(delivery.message, *targets):
        central.facts.append(facts.Dropped(delivery.id, "too many messages wait for its handler"))
    else:
        central.dispatcher.route(delivery, *targets)


def copies(central: State, original: Delivery) -> list[tuple[Delivery, ModuleResource]]:
    """One delivery for each handler of a broadcast or multi-query that has somebody to handle it."""
    made = []
    for handler in original.message.handlers:
        if not handler.resource.capacity:
            continue
        copy = Delivery(central.new_id(), original.message, original.body, original.sender)
        copy.message_id, copy.priority, copy.context = original.id, original.priority, original.context
        made.append((copy, handler.resource))
    return made
