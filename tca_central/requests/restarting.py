"""Central was away and is back, with all that it knew: its connections are awaited, and no task
starts before all are back or lost, or somebody says so.

A connection that says hello again goes on as after any break. One that does not in time is lost
(joining.py); whether its handlers did what they had to is not known then, so that their tasks fail
as uncertain.
"""

from tca_central.events import AWAY, ConnectionId, Restarted
from tca_central.model.clock import checked_seconds
from tca_central.model.deliveries import Connection
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.packets import headers
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
    central.hold.grace = central.clock.after(
        checked_seconds(event.grace, "a grace"), Due.GRACE, None
    )
    central.facts.append(
        facts.CentralRestarted(event.away, len(known), event.hold, event.skipped > 0, event.aside)
    )
    go_on_if_complete(central)


def go_on_if_complete(central: State) -> None:
    """Let tasks start again when nobody is awaited any more, and nobody is to be asked."""
    if central.dispatcher.is_holding and not central.hold.awaited and not central.hold.until_told:
        _go_on(central, "")


def on_go_on(central: State, connection: Connection, header: headers.GoOn, _: bytes) -> None:
    """Somebody says that tasks may start again, whoever is not back yet."""
    if central.dispatcher.is_holding:
        central.hold.until_told = False
        _go_on(central, connection.module.name)
        central.accept(connection, header.number, 1)
    else:
        central.ignore(
            connection, header.number, "nothing holds tasks back since a restart of central"
        )


def _go_on(central: State, by: str) -> None:
    if not central.hold.awaited:
        central.clock.cancel(central.hold.grace)
        central.hold.grace = None
    central.dispatcher.go_on(central.registry.modules.values())
    central.facts.append(facts.WentOn(by))
