"""What central itself broadcasts about who is there. Nothing is sent, or recorded, that nobody listens to."""

from tca_central.fan_out import copies, route_or_drop
from tca_central.registry import Delivery
from tca_central.state import State
from tca_wire import facts
from tca_wire.declarations import D
from tca_wire.notices import Notice
from tca_wire.points import ROOT

SENDER = "central"
"""Who sends notices, in the journal."""


def tell(central: State, notice: Notice[D], data: D) -> None:
    """Send a notice to all who handle it."""
    message = central.registry.messages.get(notice.name)
    if message is None or not message.serving:
        return
    made = Delivery(central.new_id(), message, notice.encode_data(data), None)
    kind = message.message_class
    central.facts.append(facts.Received(made.id, message.name, kind, SENDER, ROOT, 0, False, made.body, []))
    for copy, resource in copies(central, made):
        route_or_drop(central, copy, resource)
