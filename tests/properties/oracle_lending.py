"""The rules of lent slots.

Only the newest handler at work in a slot lends it, and only while it waits. A task below a delivery
of the slot is delivered at once if the wait is for the task, or for one above it. If all handlers
of the slot reply later, every task below them is delivered at once. Central finds other tasks that
the wait needs by its search for deadlocks, so the oracle lets it choose when.
"""

from collections.abc import Iterator

from properties import oracle_locks, oracle_slots
from properties.oracle_records import STARTS, Claim, Job, Node, World

from tca_wire.points import Moment

MOST_IN_SLOT = 20
Need = tuple[str, Job | Claim]
"""Something that must happen: a task's "start" or "end", the "turn" of a queued message, the return
of a "handler", or a "claim" that must be granted or released.
"""


def in_slot(world: World, slot: str) -> list[Job]:
    """Return what a slot has, oldest first."""
    return sorted((job for job in world.everything() if job.slot == slot), key=lambda one: one.turn)


def newest_at_work(world: World, slot: str) -> Job | None:
    at_work = [job for job in in_slot(world, slot) if not job.is_postponed]
    return at_work[-1] if at_work else None


def _may_be_lent(world: World, slot: str) -> bool:
    resource = world.slots[slot]
    is_busy = slot not in oracle_slots.free_slots(world).get(resource, set())
    is_full = len(in_slot(world, slot)) >= MOST_IN_SLOT
    return is_busy and not is_full and not oracle_locks.is_locked(world, resource)


def lent_at_once(world: World) -> Iterator[tuple[str, list[Node]]]:
    """Yield each slot that is to be lent, with the queued tasks that it may handle."""
    waiting = [node for node in world.nodes.values() if node.waiting and not node.kind.is_monitor]
    for node in waiting:
        if oracle_slots.targets(world, node) != node.noted_for:  # it was queued elsewhere
            note(world, node)
    for slot in world.slots:
        found = [node for node in waiting if node.noted_at == slot and _is_below(node, slot)]
        found = [one for one in found if world.slots[slot] in oracle_slots.targets(world, one)]
        if not found or not _may_be_lent(world, slot):
            continue
        if (handler := newest_at_work(world, slot)) is not None:
            awaited = [node for node, _ in _awaited(world, handler)]
            found = [node for node in found if not set(node.lineage()).isdisjoint(awaited)]
        if found:
            yield slot, found


def note(world: World, node: Node) -> None:
    """Note at which slot a queued task may be handled within a wait: the slot of its nearest
    ancestor that has a slot of the task's resources.
    """
    node.noted_for = resources = oracle_slots.targets(world, node)
    above = (one.slot for one in node.lineage()[1:] if one.slot)
    node.noted_at = next((slot for slot in above if world.slots.get(slot) in resources), "")


def note_below(world: World, node: Node) -> None:
    """Note the tasks that wait below a task whose handler begins, at the resource of its slot."""
    for below in world.subtree(node)[1:]:
        if below.waiting and world.slots[node.slot] in oracle_slots.targets(world, below):
            note(world, below)


def _is_below(node: Node, slot: str) -> bool:
    return any(above.slot == slot for above in node.lineage())


def _awaited(world: World, handler: Job) -> list[tuple[Node, Moment]]:
    """Return the points for which a handler waits."""
    return [
        (wait.node, wait.moment)
        for (sender, _), wait in world.waits.items()
        if sender == handler.slot
        and handler.handling_id in (wait.holds_back, wait.coroutine)
        and wait.moment not in wait.node.past
    ]


# --- tasks that a wait needs ----------------------------------------------------------------------


def may_be_lent_for(world: World, node: Node, slot: str) -> bool:
    """Whether a slot's newest handler needs a queued task, in the end, so that it can go on."""
    handler = newest_at_work(world, slot)
    resources = oracle_slots.targets(world, node)
    if handler is None or world.slots[slot] not in resources or not _may_be_lent(world, slot):
        return False
    needs: list[Need] = [("handler", handler)]
    for need in needs:  # grows while it is walked
        if need == ("turn", node):
            return True
        needs += [one for one in _needs_of(world, *need) if one not in needs]
    return False


def _needs_of(world: World, what: str, one: Job | Claim) -> Iterator[Need]:
    if isinstance(one, Claim):
        yield from _needs_of_claim(world, one)
    elif what == "handler":
        yield from _needs_of_handler(world, one)
    elif what == "turn":
        for resource in oracle_slots.targets(world, one):
            yield from _needs_of_resource(world, resource)
    elif isinstance(one, Node):
        yield from _needs_of_task(world, one, what)


def _needs_of_task(world: World, node: Node, what: str) -> Iterator[Need]:
    assert node.parent is not None
    if node.waiting:
        yield "turn", node
    if node.slot:
        yield "handler", node
    if node.parent.parent is not None:
        yield "start", node.parent
    for other in (*node.checks, *node.asking):
        yield "end", other
    for pair in world.pairs:
        if pair.after[0] is node and pair.before is not None:
            yield "start" if pair.before[1] in STARTS else "end", pair.before[0]
    if what == "end" or node.again:
        for child in world.children(node):
            yield "end", child


def _needs_of_handler(world: World, job: Job) -> Iterator[Need]:
    for node, moment in _awaited(world, job):
        yield "start" if moment in STARTS else "end", node
    for other in world.everything():
        if other.slot == job.slot and other.turn > job.turn:
            yield "handler", other
    yield from _needs_of_answers(world, job.slot)


def _needs_of_answers(world: World, connection: str) -> Iterator[Need]:
    """Yield the queries and claims that a connection has sent, and that are to be answered."""
    for other in world.everything():
        if other.kind.has_reply and other.sender == connection:
            yield "handler" if other.slot else "turn", other
    for claim in world.claims:
        if claim.sender == connection and not claim.granted:
            yield "claim", claim


def _needs_of_resource(world: World, resource: tuple[str, str]) -> Iterator[Need]:
    for job in world.everything():
        if job.slot and world.slots.get(job.slot) == resource:
            yield "handler", job
        elif job.waiting and resource in oracle_slots.targets(world, job):
            yield "turn", job
    for claim in world.claims:
        if claim.resource == resource:
            yield "claim", claim


def _needs_of_claim(world: World, claim: Claim) -> Iterator[Need]:
    if not claim.granted:
        yield from _needs_of_resource(world, claim.resource)
    elif claim.holder is not None:
        yield "handler" if claim.holder.slot else "end", claim.holder
    else:
        yield from _needs_of_program(world, claim.sender)
    for job in in_slot(world, claim.sender):
        yield "handler", job


def _needs_of_program(world: World, connection: str) -> Iterator[Need]:
    """Yield what a connection waits for that may release a claim from outside its handlers."""
    for (sender, _), wait in world.waits.items():
        if sender == connection and wait.moment not in wait.node.past:
            yield "start" if wait.moment in STARTS else "end", wait.node
    yield from _needs_of_answers(world, connection)
