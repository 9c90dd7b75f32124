"""The rules of locks and reservations: when a claim is granted, what it keeps out, when it ends.

A claim waits in one line with the messages, until its resource is empty except for its own handler.
The oracle looks for no deadlocks; test_deadlocks.py judges them. If central calls a deadlock, the
refused wait ends as if its sender had given up. The claim that it takes away ends the same way. The
failure that it raises counts as raised by another module.
"""

from properties import oracle_failures, oracle_slots
from properties.oracle_records import Claim, Job, Node, World, is_deadlock, is_lock_lost

from tca_wire.journal import facts
from tca_wire.packets import headers

INSIDE = float("inf")
"""The priority of a claim by a handler in that resource: all others wait for this handler."""


def lock(world: World, connection: str, header: headers.Lock) -> None:
    """A connection wants a resource; central says which one that is."""
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
    """The busy slots of a resource."""
    ours = {slot for slot, its_resource in world.slots.items() if its_resource == resource}
    return ours - oracle_slots.free_slots(world).get(resource, set())


def granted_claim(world: World, resource: tuple[str, str]) -> Claim | None:
    """The granted claim of a resource."""
    return next(
        (claim for claim in world.claims if claim.resource == resource and claim.granted), None
    )


def pending_claims(world: World, resource: tuple[str, str]) -> list[Claim]:
    """The pending claims of a resource without a granted one."""
    return (
        []
        if granted_claim(world, resource)
        else [claim for claim in world.claims if claim.resource == resource]
    )


def admits(world: World, job: Job, resource: tuple[str, str]) -> bool:
    """Whether neither a lock nor a reservation keeps a message out."""
    claim = granted_claim(world, resource)
    return claim is None or (claim.reserves and claim.module == job.module)


def is_locked(world: World, resource: tuple[str, str]) -> bool:
    """Whether a resource is locked rather than reserved."""
    claim = granted_claim(world, resource)
    return claim is not None and not claim.reserves


def may_be_granted(world: World, claim: Claim) -> bool:
    """Whether the claimed resource is empty, except for the claim's sender."""
    return busy_slots(world, claim.resource) <= {claim.sender}


# --- ends -----------------------------------------------------------------------------------------


def end_for(world: World, job: Job) -> None:
    """Claims of a task or message end with it."""
    world.claims = [claim for claim in world.claims if claim.holder is not job]


def killed(world: World, node: Node) -> None:
    """A killed task gets no further claim; it keeps its granted ones while its handler runs."""
    world.claims = [
        claim for claim in world.claims if claim.holder is not node or (claim.granted and node.slot)
    ]


def left(world: World, connection: str) -> None:
    """A connection is gone."""
    world.claims = [claim for claim in world.claims if claim.sender != connection]


def module_left(world: World, module: str) -> None:
    """A module is gone with its resources."""
    world.claims = [claim for claim in world.claims if claim.resource[0] != module]


def give_up(world: World, sender: str, number: int) -> None:
    """A claim is released or withdrawn."""
    world.claims = [
        claim for claim in world.claims if (claim.sender, claim.number) != (sender, number)
    ]


def unlock(world: World, header: headers.Unlock) -> None:
    """Take a resource away from its lock holder."""
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
    """Central raises "lock lost" on a task whose claim was taken away, unless it has failed
    already.
    """
    oracle_slots.give_messages(world)  # wiretaps were fired first, as the handler returned
    fact = world.seen.given[0][0] if world.seen.given else None
    if is_lock_lost(fact) and fact.id == node.id:
        del world.seen.given[0]
        oracle_failures.raise_beside(world, node, ("lock lost",))


def time_out(world: World) -> None:
    """End the claims whose timeout has passed."""
    world.claims = [claim for claim in world.claims if claim.granted or claim.due > world.due_by]


# --- deadlocks ------------------------------------------------------------------------------------


def end_deadlocks(world: World) -> bool:
    """End the waits that central calls deadlocks now. Returns whether there were any."""
    any_ended = False
    while world.seen.given and is_deadlock(fact := world.seen.given[0][0]):
        del world.seen.given[0]
        any_ended = True
        if isinstance(fact, facts.ClaimEnded):
            world.claims = [claim for claim in world.claims if claim.id != fact.id]
        elif isinstance(fact, facts.RequestRefused):
            oracle_slots.give_up(world, *world.seen.deadlocked.pop(0))
        elif isinstance(fact, facts.Failed):
            oracle_failures.raise_beside(world, world.nodes[fact.id], (fact.failure,))
    return any_ended
