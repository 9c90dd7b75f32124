"""Awaits all known connections after a restart that has recovered central's state.

No task starts before all connections are back or lost, or an operator resumes tasks. A connection
that says hello continues as after any break. One that does not say hello in time is lost
(joining.py). Central can't know whether the handlers of a lost connection did their work. Their
tasks therefore fail with the failure "uncertain".
"""

from tca_central.events import AWAY, ConnectionId, Restarted
from tca_central.model.clock import checked_seconds
from tca_central.model.deliveries import Connection
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.vocabulary import Due


def on_restarted(central: State, event: Restarted) -> None:
    """Mark every connection as broken, and start no task until they are back."""
    registry, pause, tree = central.registry, central.restart_pause, central.tree
    if event.skipped:
        first, tree.newest = tree.newest + 1, tree.newest + event.skipped
        central.lost_ids.append((first, tree.newest))
    known = list(registry.connections.values())
    registry.connections.clear()
    for number, connection in enumerate(known):
        connection.id = ConnectionId(AWAY + str(number).encode())
        connection.pulse = b""
        registry.connections[connection.id] = connection
    pause.awaited, pause.until_resumed = dict.fromkeys(known), event.hold
    central.dispatcher.are_tasks_paused = True
    central.clock.cancel(pause.grace)
    pause.grace = central.clock.after(checked_seconds(event.grace, "a grace"), Due.GRACE, None)
    central.facts.append(
        facts.CentralRestarted(event.away, len(known), event.hold, event.skipped > 0, event.aside)
    )
    release_if_complete(central)


def release_if_complete(central: State) -> None:
    """Let tasks start again when no connection is awaited, and no operator must resume them."""
    pause = central.restart_pause
    if central.dispatcher.are_tasks_paused and not (pause.awaited or pause.until_resumed):
        _release_tasks(central, "")


def on_go_on(central: State, connection: Connection, header: headers.GoOn, _: bytes) -> None:
    """Let tasks start again, as an operator requests, although connections are missing."""
    if central.dispatcher.are_tasks_paused:
        central.restart_pause.until_resumed = False
        _release_tasks(central, connection.module.name)
        central.accept(connection, header.number, 1)
    else:
        central.ignore(
            connection, header.number, "nothing holds tasks back since a restart of central"
        )


def _release_tasks(central: State, by: str) -> None:
    """Let tasks start again, as module *by* requests ("": no connection is awaited any more)."""
    if not central.restart_pause.awaited:
        central.clock.cancel(central.restart_pause.grace)
        central.restart_pause.grace = None
    central.dispatcher.release_tasks(central.registry.modules.values())
    central.facts.append(facts.WentOn(by))
