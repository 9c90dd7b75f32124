"""Revokes locks and reservations for operators or to end deadlocks, and warns their holders.

If the handler that made the lock still runs, it is notified. It fails with "lock lost" unless it
catches this failure. If the handler has returned, the failure is raised on the task that keeps the
lock.
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
    """Revoke the claim on a resource, as an operator requests."""
    claim = find_resource(central, header.resource, header.module).held_by
    if claim is not None:
        by = f"by module '{connection.module.name}'"
        revoke_and_warn(central, claim, by, LOCK_LOST, f"unlocked {by}")
    central.accept(connection, header.number, claim.id if claim is not None else 0)


def revoke_and_warn(central: State, claim: ModuleClaim, why: str, failure: str, text: str) -> None:
    """Revoke a claim. If the handler that made it has returned, raise *failure* on the task."""
    revoke(central, claim, why, text)
    if (task := task_holding(claim)) is not None:
        _raise_loss(central, task, failure, f"'{claim.resource.name}' was taken from it: {text}")


def fail_for_lost_locks(central: State, slot: Connection, task: Task) -> None:
    """Fail a task whose handler returned without noticing the loss of a lock."""
    if text := pop_losses(slot, task):
        _raise_loss(central, task, LOCK_LOST, text)


def task_holding(claim: ModuleClaim) -> Task | None:
    """Return the task for which a claim is kept; None unless the claim's handler has returned."""
    holder = claim.holder
    return holder if isinstance(holder, Task) and holder.slot is None else None


def _raise_loss(central: State, task: Task, failure: str, text: str) -> None:
    """Raise the failure that a task has lost its lock, unless the task has failed already."""
    has_failed = task.failure is not None and not task.is_dealt_with
    if not (has_failed or task.retry_pending or task.killed):
        raise_failure(central, task, RaisedFailure(failure, text))
