"""Central was away and is back, with all that it knew: its connections are awaited, and no task starts meanwhile.

A connection that says hello again goes on as after any break. One that does not in time is lost; whether its handlers
did what they had to is not known then, so that their tasks fail as uncertain.
"""

from tca_central.control.holding import go_on_if_complete
from tca_central.events import AWAY, ConnectionId, Restarted
from tca_central.model.clock import checked_seconds
from tca_central.requests.joining import disconnect
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.vocabulary import Due


def on_restarted(central: State, event: Restarted) -> None:
    """Every connection has broken, and may come back."""
    registry = central.registry
    if event.skipped:
        first, central.tree.newest = central.tree.newest + 1, central.tree.newest + event.skipped
        central.lost.append((first, central.tree.newest))
    known = list(registry.connections.values())
    registry.connections.clear()
    for number, connection in enumerate(known):
        connection.id = ConnectionId(AWAY + str(number).encode())
        connection.pulse = b""
        registry.connections[connection.id] = connection
    central.hold.awaited = dict.fromkeys(known)
    central.hold.until_told = event.hold
    central.dispatcher.is_holding = True
    central.clock.cancel(central.hold.grace)
    central.hold.grace = central.clock.after(checked_seconds(event.grace, "a grace"), Due.GRACE, None)
    central.facts.append(facts.CentralRestarted(event.away, len(known), event.hold, event.skipped > 0, event.aside))
    go_on_if_complete(central)


def on_grace_over(central: State, _: None) -> None:
    """Those who are not back by now are lost."""
    central.hold.grace = None
    for connection in list(central.hold.awaited):
        if connection in central.hold.awaited:
            disconnect(central, connection, "it did not come back when central did", lost=True)
