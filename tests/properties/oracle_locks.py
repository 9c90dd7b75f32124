"""The rules of locks and reservations: when a claim is granted and ends, and what it keeps out.

A claim waits in one line with the messages, until no slot of its resource is busy except the slot
that claims. The oracle looks for no deadlocks; test_deadlocks.py judges them. Central ends a
deadlock in one of three ways. If central refuses a wait or takes a claim away, the oracle ends the
wait or claim as if its sender had given up. If central raises a failure, the oracle raises it, too.
"""

from properties import oracle_failures, oracle_slots
from properties.oracle_records import Claim, Job, Node, World, is_deadlock, is_lock_lost

from tca_wire.journal import facts
from tca_wire.packets import headers

INSIDE = float("inf")
"""The priority of a claim by a busy slot of the claimed resource. All other messages and claims
there wait for the handler in that slot.
"""


def lock(world: World, connection: str, header: headers.Lock) -> None:
    """Add the claim of a connection. Central's fact says which resource is claimed."""
    fact = next(fact for fact in world.seen.facts if isinstance(fact, facts.Claimed))
    holders = [
        job
        for job in world.everything()
        if job.slot and header.origin and job.handling_id == header.origin
    ]
    resource = fact.module, fact.resource
    is_inside = connection in busy_slots(world, resource)
    claim = Claim(
        fact.id,
        resource,
        connection,
        header.number,
        world.modules[connection],
        reserves=header.reserve,
    )
    claim.holder = holders[0] if holders else None
    claim.priority = INSIDE if is_inside else header.priority
    claim.since = claim.arrival = (world.step, world.round)
    if header.timeout >= 0:
        claim.due = world.time + header.timeout
    world.claims.append(claim)


# --- grants ---------------------------------------------------------------------------------------


def busy_slots(world: World, resource: tuple[str, str]) -> set[str]:
    """Return the busy slots of a resource."""
    ours = {slot for slot, its_resource in world.slots.items() if its_resource == resource}
    return ours - oracle_slots.free_slots(world).get(resource, set())


def granted_claim(world: World, resource: tuple[str, str]) -> Claim | None:
    """Return the granted claim of a resource, if there is one."""
    return next(
        (claim for claim in world.claims if claim.resource == resource and claim.granted), None
    )


def pending_claims(world: World, resource: tuple[str, str]) -> list[Claim]:
    """Return the pending claims of a resource; none while a claim of the resource is granted."""
    return (
        []
        if granted_claim(world, resource)
        else [claim for claim in world.claims if claim.resource == resource]
    )


def admits(world: World, job: Job, resource: tuple[str, str]) -> bool:
    """Whether a resource may handle a message: no lock, and no reservation for another module,
    keeps the message out.
    """
    claim = granted_claim(world, resource)
    return claim is None or (claim.reserves and claim.module == job.module)


def is_locked(world: World, resource: tuple[str, str]) -> bool:
    """Whether a resource is locked rather than reserved."""
    claim = granted_claim(world, resource)
    return claim is not None and not claim.reserves


def may_be_granted(world: World, claim: Claim) -> bool:
    """Whether no slot of the claimed resource is busy, except the claim's sender."""
    return busy_slots(world, claim.resource) <= {claim.sender}


# --- ends -----------------------------------------------------------------------------------------


def end_for(world: World, job: Job) -> None:
    """End the claims of a task or message that has ended."""
    world.claims = [claim for claim in world.claims if claim.holder is not job]


def killed(world: World, node: Node) -> None:
    """Drop the pending claims of a killed task. Its granted claims last while its handler runs."""
    world.claims = [
        claim for claim in world.claims if claim.holder is not node or (claim.granted and node.slot)
    ]


def left(world: World, connection: str) -> None:
    """End the claims of a connection that has left."""
    world.claims = [claim for claim in world.claims if claim.sender != connection]


def module_left(world: World, module: str) -> None:
    """End the claims of the resources of a module that has left."""
    world.claims = [claim for claim in world.claims if claim.resource[0] != module]


def give_up(world: World, sender: str, number: int) -> None:
    """End a claim that its sender releases or withdraws."""
    world.claims = [
        claim for claim in world.claims if (claim.sender, claim.number) != (sender, number)
    ]


def unlock(world: World, header: headers.Unlock) -> None:
    """Take a resource away from the holder of its granted claim."""
    places = {header.module} if header.module else {module for module, _ in world.slots.values()}
    taken = [
        claim
        for claim in world.claims
        if claim.granted and claim.resource[1] == header.resource and claim.resource[0] in places
    ]
    world.claims = [claim for claim in world.claims if claim not in taken]
    for claim in taken:
        if isinstance(claim.holder, Node) and not claim.holder.slot:
            raise_lock_lost(world, claim.holder)


def raise_lock_lost(world: World, node: Node) -> None:
    """Raise "lock lost" on a task if central has raised it next. Central raises it for a claim that
    was taken away, unless the task has failed already.
    """
    oracle_slots.give_messages(world)  # the handler's return fired wiretaps first
    fact = world.seen.given[0][0] if world.seen.given else None
    if is_lock_lost(fact) and fact.id == node.id:
        del world.seen.given[0]
        oracle_failures.raise_beside(world, node, ("lock lost",))


def time_out(world: World) -> None:
    """End the pending claims whose timeout has passed."""
    world.claims = [claim for claim in world.claims if claim.granted or claim.due > world.due_by]


# --- deadlocks ------------------------------------------------------------------------------------


def end_deadlocks(world: World) -> bool:
    """Apply the deadlocks that central reports next: end the waits and claims, raise the failures.
    Return whether there were any.
    """
    any_ended = False
    while world.seen.given and is_deadlock(fact := world.seen.given[0][0]):
        if world.seen.deadlocked[:1] == [world.unread] and isinstance(fact, facts.RequestRefused):
            break
        del world.seen.given[0]
        any_ended = True
        if isinstance(fact, facts.ClaimEnded):
            world.claims = [claim for claim in world.claims if claim.id != fact.id]
        elif isinstance(fact, facts.RequestRefused):
            oracle_slots.give_up(world, *world.seen.deadlocked.pop(0))
        elif isinstance(fact, facts.Failed):
            oracle_failures.raise_beside(world, world.nodes[fact.id], (fact.failure,))
    return any_ended
