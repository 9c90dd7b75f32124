"""Handlers that hang: nobody waits for them any more, and they do not return. Where their slot says after how long that
is so, it is given up, and its module is told to put another in its place.
"""

from tca_central.model.deliveries import Delivery
from tca_central.requests.joining import disconnect
from tca_central.state import State
from tca_wire.packets import headers


def on_hung(central: State, delivery: Delivery) -> None:
    """A handler that should have returned has not."""
    slot = delivery.slot
    if slot is None or slot.doubts.pop(delivery.given_as, None) is None or slot.resource is None:
        return
    what = f"its handler of '{delivery.message.name}' hangs: nobody has waited for it for {slot.hung_after:g} s"
    slot.was_replaced = True
    slot.resource.replaced += 1
    module = slot.module
    disconnect(central, slot, what, lost=True)
    for own in module.connections.values():
        if own.resource is None:
            central.tell(own, headers.Replace(slot.number, what))
