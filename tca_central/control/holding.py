"""After a restart of central no task starts before all connections are back or lost, or somebody says so."""

from tca_central.model.deliveries import Connection
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.packets import headers


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
        central.ignore(connection, header.number, "nothing holds tasks back since a restart of central")


def _go_on(central: State, by: str) -> None:
    if not central.hold.awaited:
        central.clock.cancel(central.hold.grace)
        central.hold.grace = None
    central.dispatcher.go_on(central.registry.modules.values())
    central.facts.append(facts.WentOn(by))
