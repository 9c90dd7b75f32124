"""The rules of locks and reservations: who may have a resource for himself, whom that keeps out,
and when it ends.

Who wants one waits in line with the messages, until nobody is in the resource but himself.
Deadlocks are not sought here (test_deadlocks.py looks after those): a wait that central refuses for
one ends as if its sender had given up, so does what it takes away, and a failure that it raises for
one is raised by somebody.
"""

from properties import oracle_failures, oracle_slots
from properties.oracle_records import Claim, Job, Node, World, is_deadlock, is_lock_lost

from tca_wire.journal import facts
from tca_wire.packets import headers

INSIDE = float(
    "inf"
)  # the priority of who asks from inside: nobody else's turn comes before he is out


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


# --- who gets in ----------------------------------------------------------------------------------


def busy_slots(world: World, resource: tuple[str, str]) -> set[str]:
    """The slots of a resource that somebody is in."""
    mine = {slot for slot, its_resource in world.slots.items() if its_resource == resource}
    return mine - oracle_slots.free_slots(world).get(resource, set())


def owner(world: World, resource: tuple[str, str]) -> Claim | None:
    """Who has the resource."""
    return next(
        (claim for claim in world.claims if claim.resource == resource and claim.granted), None
    )


def in_line(world: World, resource: tuple[str, str]) -> list[Claim]:
    """Who wants a resource that nobody has."""
    return (
        []
        if owner(world, resource)
        else [claim for claim in world.claims if claim.resource == resource]
    )


def lets_in(world: World, job: Job, resource: tuple[str, str]) -> bool:
    """Whether neither a lock nor a reservation keeps a message out."""
    claim = owner(world, resource)
    return claim is None or (claim.reserves and claim.module == job.module)


def is_locked(world: World, resource: tuple[str, str]) -> bool:
    """Whether it is locked, not only reserved."""
    claim = owner(world, resource)
    return claim is not None and not claim.reserves


def may_have_it(world: World, claim: Claim) -> bool:
    """Whether nobody else is in the resource that is wanted."""
    return busy_slots(world, claim.resource) <= {claim.sender}


# --- ends -----------------------------------------------------------------------------------------


def end_for(world: World, job: Job) -> None:
    """What was locked for a task or message ends with it."""
    world.claims = [claim for claim in world.claims if claim.holder is not job]


def killed(world: World, node: Node) -> None:
    """A killed task gets nothing more, and keeps what it has only while its handler runs."""
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
    """Who has or wants a resource wants it no longer."""
    world.claims = [
        claim for claim in world.claims if (claim.sender, claim.number) != (sender, number)
    ]


def unlock(world: World, header: headers.Unlock) -> None:
    """Somebody takes a resource from whoever has it."""
    places = {header.module} if header.module else {module for module, _ in world.slots.values()}
    taken = [
        claim
        for claim in world.claims
        if claim.granted and claim.resource[1] == header.resource and claim.resource[0] in places
    ]
    world.claims = [claim for claim in world.claims if claim not in taken]
    for claim in taken:
        if isinstance(claim.holder, Node) and not claim.holder.slot:
            warn(world, claim.holder)


def warn(world: World, node: Node) -> None:
    """Central raises "lock lost" on a task that keeps what was taken away; not if it knows of a
    failure already.
    """
    oracle_slots.give_messages(world)  # wiretaps were fired first, as the handler returned
    fact = world.seen.given[0][0] if world.seen.given else None
    if is_lock_lost(fact) and fact.id == node.id:
        del world.seen.given[0]
        oracle_failures.raise_beside(world, node, ("lock lost",))


def time_out(world: World) -> None:
    """Some have waited long enough."""
    world.claims = [claim for claim in world.claims if claim.granted or claim.due > world.due_by]


# --- deadlocks ------------------------------------------------------------------------------------


def end_deadlocks(world: World) -> bool:
    """End the waits that central calls deadlocks at this moment; whether there were any."""
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
