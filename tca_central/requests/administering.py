"""Handles events of the operator, and events that central itself raises."""

from collections.abc import Callable
from typing import Any

from tca_central.events import (
    ConfirmTasks,
    DiskSpace,
    KeysChanged,
    LimitsSet,
    MembersChanged,
    PermissionsChanged,
    Restarted,
)
from tca_central.requests import permissions, restarting
from tca_central.state import State
from tca_wire.journal import facts


def _on_confirm_tasks(central: State, _: ConfirmTasks) -> None:
    for connection in list(central.unconfirmed):
        central.confirm_tasks(connection)


def _on_disk_space(central: State, event: DiskSpace) -> None:
    central.is_disk_low = event.is_low
    central.facts.append(facts.DiskSpace(event.is_low))


def _on_members_changed(central: State, event: MembersChanged) -> None:
    central.members = event
    ready = [one for one in event.standbys if not one.is_manual]
    processes, behind = [one.process for one in ready], [one.process for one in ready if one.behind]
    central.facts.append(facts.MembersChanged(event.leader, processes, behind))


def _on_keys_changed(central: State, event: KeysChanged) -> None:
    central.facts.append(facts.KeysChanged(event.allowed, event.revoked))


ADMIN_HANDLERS: dict[type, Callable[[State, Any], None]] = {
    ConfirmTasks: _on_confirm_tasks,
    DiskSpace: _on_disk_space,
    KeysChanged: _on_keys_changed,
    LimitsSet: State.set_limits,
    MembersChanged: _on_members_changed,
    PermissionsChanged: permissions.change_permissions,
    Restarted: restarting.on_restarted,
}
"""By the class of an event: the function that handles it."""
