"""Locks and reservations are revoked: by an operator, or because of a deadlock. Whoever relies on
one is told.

A handler that runs is told by its module, where it made the lock (claims.take). It fails there with
"lock lost" unless it sees to that itself. What is *kept*, because the handler has returned, has
nobody to be told: so the failure is raised on the task.
"""

from tca_central.failing.failures import raise_failure
from tca_central.locks.claims import find_resource, pop_losses, revoke
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import Connection, ModuleClaim
from tca_central.model.tasks import Task
from tca_central.state import State
from tca_wire.messages.failures import LOCK_LOST
from tca_wire.packets import headers


def on_unlock(central: State, connection: Connection, header: headers.Unlock, _: bytes) -> None:
    """A module frees a resource that any module has."""
    claim = find_resource(central, header.resource, header.module).held_by
    if claim is not None:
        by = f"by module '{connection.module.name}'"
        revoke_and_warn(central, claim, by, LOCK_LOST, f"unlocked {by}")
    central.accept(connection, header.number, claim.id if claim is not None else 0)


def revoke_and_warn(central: State, claim: ModuleClaim, why: str, failure: str, text: str) -> None:
    """Take a resource away. If the handler has returned, *failure* is raised on its task."""
    revoke(central, claim, why, text)
    if (task := keeper_of(claim)) is not None:
        _warn(
            central,
            task,
            RaisedFailure(failure, f"'{claim.resource.name}' was taken from it: {text}"),
        )


def warn_of_losses(central: State, slot: Connection, task: Task) -> None:
    """A handler has returned without having asked what became of its lock, which its task was to
    keep.
    """
    if text := pop_losses(slot, task):
        _warn(central, task, RaisedFailure(LOCK_LOST, text))


def keeper_of(claim: ModuleClaim) -> Task | None:
    """The task whose end alone ends a claim: the handler that made it has returned. None if there
    is no such task.
    """
    holder = claim.holder
    return holder if isinstance(holder, Task) and holder.slot is None else None


def _warn(central: State, task: Task, failure: RaisedFailure) -> None:
    knows = task.failure is not None and not task.is_dealt_with
    if not (knows or task.retrying or task.killed):
        raise_failure(central, task, failure)
