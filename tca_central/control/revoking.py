"""Locks and reservations are taken away: by an operator, or because of a deadlock. Whoever counts on one is told.

A handler that runs is told by its module, where it made the lock (claims.take). It fails there with "lock lost" unless
it sees to that itself. What is *kept*, because the handler has returned, has nobody to be told: so the failure is
raised on the task.
"""

from tca_central.failing.failures import raise_failure
from tca_central.locks.claims import find_resource, take, taken_from
from tca_central.model.deliveries import Connection
from tca_central.model.resources import Claim
from tca_central.model.task_tree import Task
from tca_central.state import Failure, State
from tca_wire.messages.failures import LOCK_LOST
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted


def on_unlock(central: State, connection: Connection, header: headers.Unlock, _: bytes) -> None:
    """Somebody frees a resource, whoever has it."""
    claim = find_resource(central, header.resource, header.module).held_by
    if claim is not None:
        by = f"by module '{connection.module.name}'"
        take_away(central, claim, by, LOCK_LOST, f"unlocked {by}")
    central.send(connection, header.number, Accepted(header.number, claim.id if claim is not None else 0))


def take_away(central: State, claim: Claim[Connection], why: str, failure: str, text: str) -> None:
    """Take a resource from whoever has it. A task whose handler has returned gets *failure*, so that it does not go on
    unwarned; not if it has failed already, or is about to be handled again and will begin without it.
    """
    take(central, claim, why, text)
    if is_kept(claim):
        _warn(central, claim.holder, Failure(failure, f"'{claim.resource.name}' was taken from it: {text}"))


def warn_if_taken(central: State, slot: Connection, task: Task) -> None:
    """A handler has returned without having asked what became of its lock, which its task was to keep."""
    if text := taken_from(slot, task):
        _warn(central, task, Failure(LOCK_LOST, text))


def is_kept(claim: Claim[Connection]) -> bool:
    """Whether only the end of a task ends it: the handler that made it has returned."""
    return isinstance(claim.holder, Task) and claim.holder.slot is None


def _warn(central: State, task: Task, failure: Failure) -> None:
    knows = task.failure is not None and not task.is_dealt_with
    if not (knows or task.again or task.killed):
        raise_failure(central, task, failure)
