"""Applies changed permissions to connected modules."""

from tca_central.events import PermissionsChanged
from tca_central.model.deliveries import Module, Wiretap
from tca_central.model.rights import Rights, rights_of
from tca_central.model.tasks import Task, place_of
from tca_central.requests.joining import disconnect, remove_handlers
from tca_central.state import State
from tca_central.watching import taps
from tca_wire.journal import facts
from tca_wire.vocabulary import Permission


def change_permissions(central: State, event: PermissionsChanged) -> None:
    """Apply new rules, to connected modules too.

    Handlers and wiretaps that the rules do not allow are removed. Modules that the rules do not
    admit are disconnected.
    """
    central.registry.permissions.rules = event.rules
    central.facts.append(
        facts.PermissionsChanged(-1 if event.rules is None else len(event.rules), event.source)
    )
    for module in list(central.registry.modules.values()):
        rights = (
            None if event.rules is None else rights_of(event.rules, module.principal, module.called)
        )
        for connection in list(module.connections.values()):
            connection.rights = rights
            if event.rules is not None and rights is None:
                why = "the permissions do not let it in any more"
                disconnect(central, connection, why, lost=True)
        if rights is not None:
            _remove_forbidden(central, module, rights)


def _remove_forbidden(central: State, module: Module, rights: Rights) -> None:
    """Remove a module's handlers and wiretaps that its rights do not allow."""
    handled = [
        one
        for one in module.handlers.values()
        if not rights.allow(Permission.HANDLE, one.message.name)
    ]
    if handled:
        remove_handlers(central, handled)
    for tap in list(central.taps.values()):
        if module.name in tap.holders and not _may_tap(tap, rights):
            taps.remove(central, tap, module)


def _may_tap(tap: Wiretap, rights: Rights) -> bool:
    """Whether a module may keep a wiretap. A wiretap of a task may stay: it ends with the task."""
    place = place_of(tap)
    if isinstance(place, Task):
        return True
    return rights.allow(Permission.TAP, place.name) and rights.allow(
        Permission.SEND, tap.listener.name
    )
