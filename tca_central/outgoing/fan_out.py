"""One message to many handlers: a delivery of its own for each. Knows nothing of replies."""

from tca_central.model.deliveries import Delivery, ModuleResource
from tca_central.needs.texts import why_full
from tca_central.state import State, dropped_fact


def copy_of(central: State, original: Delivery) -> Delivery:
    """A delivery of the same message, for one of those who handle it."""
    copy = Delivery(central.new_id(), original.message, original.body, original.sender)
    copy.message_id, copy.priority, copy.origin = original.id, original.priority, original.origin
    copy.role, copy.context, copy.sent_by = original.role, original.context, original.sent_by
    return copy


def copies(central: State, original: Delivery) -> list[tuple[Delivery, ModuleResource]]:
    """One delivery for each handler that has somebody to handle it."""
    targets = [handler.resource for handler in original.message.handlers if handler.resource.capacity]
    return [(copy_of(central, original), target) for target in targets]


def route_statement(central: State, original: Delivery) -> None:
    """Send an inform on its way to its handler, or a broadcast to every handler."""
    if not original.message.fans_out:
        route_or_drop(central, original)
        return
    for_each = copies(central, original)
    for copy, resource in for_each:
        route_or_drop(central, copy, resource)
    if not for_each:
        central.facts.append(dropped_fact(original, "nobody listens"))


def route_or_drop(central: State, delivery: Delivery, *targets: ModuleResource) -> None:
    """Deliver or queue what nobody waits for; too much of it is dropped."""
    if central.dispatcher.is_full(delivery.message, *targets):
        central.facts.append(dropped_fact(delivery, why_full(central, delivery.message, *targets)))
    else:
        central.dispatcher.route(delivery, *targets)
