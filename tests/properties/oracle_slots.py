"""The rules of resources. A slot handles one message at a time. The next message has the highest
priority; among equals, it has waited longest. Claims wait in the same line.
"""

from collections.abc import Iterator

from properties import oracle_failures, oracle_lending, oracle_locks, oracle_rules, oracle_taps
from properties.oracle_records import Claim, Collector, Disagreement, Job, Node, World

from tca_wire.journal import facts
from tca_wire.vocabulary import Condition, MessageClass

Resource = tuple[str, str]
Choices = dict[Job | Claim, dict[str, bool]]
"""The messages that may be delivered next, each with its possible slots. True marks a slot beyond
the capacity. A claim has no slots.
"""


def targets(world: World, job: Job) -> list[Resource]:
    """Return the resources that may handle a message: of the newest handler, and of its pool."""
    if job.target:
        return [job.target]
    handlers = world.handlers.get(job.message, [])
    newest = handlers[-1:]
    return [
        (one.module, one.resource)
        for one in handlers
        if one in newest or (one.pool and one.pool == newest[0].pool)
    ]


def free_slots(world: World) -> dict[Resource, set[str]]:
    """Return the free slots of each resource."""
    busy = {job.slot for job in world.everything() if job.slot and _occupies(job)}
    free: dict[Resource, set[str]] = {}
    for slot, resource in world.slots.items():
        if slot not in busy:
            free.setdefault(resource, set()).add(slot)
    return free


def _occupies(job: Job) -> bool:
    """Whether a message occupies its slot. A nested one does when what it is nested in has gone."""
    host = job.host
    is_inside = job.nested and (host is None or (host.slot == job.slot and not host.frees_slot))
    return not (job.frees_slot or is_inside)


def give(world: World) -> bool:
    """Deliver the next message or grant the next claim, as central did. Return whether there was
    one. Messages queued since the last call are all delivered before any consequence.
    """
    is_given = _give_next_or_new(world)
    world.round += 1
    return is_given


def _give_next_or_new(world: World) -> bool:
    """Deliver or grant one, and after a new message all other new ones."""
    choices = _choices(world)
    if not choices:
        return False
    given = _give_next(world, choices)
    if given is None:
        expected = ", ".join(f"{one.id} to {sorted(slots)}" for one, slots in choices.items())
        actual = world.seen.given[0] if world.seen.given else "nothing"
        raise Disagreement(f"central delivers {actual}, but the next are: {expected}")
    while given is not None and _is_new(world, given):
        given = _give_next(
            world, {one: slots for one, slots in _choices(world).items() if _is_new(world, one)}
        )
    return True


def _is_new(world: World, one: Job | Claim) -> bool:
    return isinstance(one, Job) and one.since == (world.step, world.round)


def give_messages(world: World) -> None:
    """Deliver the messages other than tasks that may be delivered now, before anything else
    follows.
    """
    while (
        _give_next(
            world, {job: slots for job, slots in _choices(world).items() if type(job) is Job}
        )
        is not None
    ):
        pass


def _give_next(world: World, choices: Choices) -> Job | Claim | None:
    """Deliver the message or grant the claim that central chose next, if the choice is valid.
    Return it, or None.
    """
    fact, slot = world.seen.given[0] if world.seen.given else (None, "")
    for one, slots in choices.items():
        if isinstance(one, Claim):
            if isinstance(fact, facts.Granted) and one.id == fact.id:
                one.granted = True
                del world.seen.given[0]
                return one
        elif isinstance(fact, facts.Delivered) and one.id == fact.message_id and slot in slots:
            one.handling_id = fact.id
            _deliver(world, one, slot, nested=slots[slot])
            del world.seen.given[0]
            return one
    return None


def _choices(world: World) -> Choices:
    """Return the messages that may be delivered next, with their slots, and the claims that may be
    granted.
    """
    waiting = [
        (job, targets(world, job))
        for job in world.everything()
        if job.waiting and not job.kind.is_monitor
    ]
    free = free_slots(world)
    choices: Choices = {}
    for resource in dict.fromkeys([*free, *(claim.resource for claim in world.claims)]):
        claims = oracle_locks.pending_claims(world, resource)
        rivals: list[Job | Claim] = [*claims]
        rivals += [
            job
            for job, ours in waiting
            if resource in ours and oracle_locks.admits(world, job, resource)
        ]
        for one in rivals:
            if any(_is_before(other, one) for other in rivals):
                continue
            if isinstance(one, Claim) and oracle_locks.may_be_granted(world, one):
                choices[one] = {}
            elif not isinstance(one, Claim) and resource in free:
                choices.setdefault(one, {}).update(dict.fromkeys(free[resource], False))
    for one, slots in [*_nested_queries(world, choices, waiting), *_lent(world)]:
        choices[one] = slots | choices.get(one, {})
    return choices


def _lent(world: World) -> Iterator[tuple[Job | Claim, dict[str, bool]]]:
    """Yield the tasks that a slot handles next within the wait of its handler, each with it."""
    for slot, rivals in oracle_lending.lent_at_once(world):
        for one in rivals:
            if not any(_is_before(other, one) for other in rivals):
                yield one, {slot: True}
    fact, slot = world.seen.given[0] if world.seen.given else (None, "")
    if isinstance(fact, facts.Delivered) and fact.is_nested:  # central has looked for deadlocks
        node = world.nodes.get(fact.message_id)
        if node is not None and node.waiting and oracle_lending.may_be_lent_for(world, node, slot):
            yield node, {slot: True}


def _nested_queries(
    world: World, choices: Choices, waiting: list[tuple[Job, list[Resource]]]
) -> list[tuple[Job | Claim, dict[str, bool]]]:
    """Return the queries that their own sender's slot may handle, each with this slot.

    A slot waits for the answer to its query, and may itself handle the query. Its resource must not
    be locked, and no other slot may be free. A query of an earlier event may go to a free slot as
    well: a lock may have ended in this event.
    """
    asked = [
        job for job, ours in waiting if job.kind.has_reply and world.slots.get(job.sender) in ours
    ]
    return [
        (job, {job.sender: True})
        for job in asked
        if (job not in choices or job.since[0] < world.step)
        and not oracle_locks.is_locked(world, world.slots[job.sender])
    ]


def _is_before(one: Job | Claim, other: Job | Claim) -> bool:
    """Whether *one* must be delivered before *other*: by priority, then arrival. Items queued in
    one event may go in any order, unless both are tasks queued together, or one is a claim.
    """
    assert one.arrival is not None
    assert other.arrival is not None
    if isinstance(one, Claim) or isinstance(other, Claim):
        return (-one.priority, one.arrival) < (-other.priority, other.arrival)
    is_same_event = one.since[0] == other.since[0]
    is_same_instant = one.since == other.since and isinstance(one, Node) and isinstance(other, Node)
    if is_same_event and not is_same_instant:
        return False
    if one.priority != other.priority:
        return one.priority > other.priority
    return one.arrival[0] < other.arrival[0]


def _deliver(world: World, job: Job, slot: str, *, nested: bool) -> None:
    world.turns += 1
    job.nested, job.turn = nested, world.turns
    inside = [one for one in oracle_lending.in_slot(world, slot) if not one.frees_slot]
    job.host = inside[-1] if nested and inside else None
    for one in inside:  # a query that a free slot asked itself has now a handler around it
        if not nested and one.host is None:
            one.host = job
    job.slot, job.wanted, job.waiting = slot, False, False
    oracle_taps.happened(world, job, {Condition.WHILE_HANDLING})
    if isinstance(job, Node):
        oracle_lending.note_below(world, job)
        oracle_rules.started(world, job)


def wait(world: World, job: Job) -> None:
    """Queue a message other than a task."""
    job.waiting, job.wanted = True, True
    job.since = (world.step, world.round)
    job.arrival = job.arrival or job.since
    if job not in world.jobs:
        world.jobs.append(job)


def send_statement(world: World, job: Job) -> None:
    """Queue an inform for one handler, or a broadcast for all."""
    if job.kind is MessageClass.INFORM:
        wait(world, job)
    else:
        copies(world, job)


def copies(world: World, job: Job) -> list[Job]:
    """Queue a copy of a message for each handler that has a slot. Return the copies."""
    made = []
    for handler in world.handlers.get(job.message, []):
        resource = (handler.module, handler.resource)
        if resource in world.slots.values():
            copy = Job(
                job.id,
                job.message,
                job.kind,
                job.sender,
                job.module,
                job.number,
                job.priority,
                job.role,
                job.sent_for_listener,
                resource,
            )
            copy.origin, copy.about, copy.tap = job.origin, job.about, job.tap
            wait(world, copy)
            made.append(copy)
    return made


# --- answers --------------------------------------------------------------------------------------


def answered(world: World, job: Job, *, done: bool) -> None:
    """Remove a message other than a task, because it has ended. Count it for its multi-query."""
    if job in world.jobs:
        world.jobs.remove(job)
    for collector in [one for one in world.collectors if job in one.pending]:
        collector.pending.remove(job)
        collector.wanted -= done and collector.wanted > 0
        if not collector.wanted or not collector.pending:
            _complete(world, collector)


def _complete(world: World, collector: Collector) -> None:
    world.collectors.remove(collector)


def give_up(world: World, sender: str, number: int) -> None:
    """Drop a request that its sender gives up, with the undelivered messages of the request."""
    world.waits.pop((sender, number), None)
    oracle_locks.give_up(world, sender, number)
    for collector in [
        one for one in world.collectors if (one.sender, one.number) == (sender, number)
    ]:
        world.collectors.remove(collector)
        world.jobs = [job for job in world.jobs if job not in collector.pending or job.slot]
    ours = [
        job
        for job in world.jobs
        if (job.sender, job.number) == (sender, number) and job.kind.has_reply
    ]
    world.jobs = [job for job in world.jobs if job not in ours or job.slot or job.target]


# --- modules come and go --------------------------------------------------------------------------


def remove_handler(world: World, message: str, module: str) -> None:
    """Remove a module's handler of a message. Queued copies for this module fail."""
    removed = [one for one in world.handlers.get(message, []) if one.module == module]
    for handler in removed:
        world.handlers[message].remove(handler)
        for job in list(world.jobs):
            if job.message == message and job.target == (module, handler.resource) and job.waiting:
                answered(world, job, done=False)


def is_served(world: World, message: str) -> bool:
    """Whether a message has a handler with a slot."""
    handlers = world.handlers.get(message, [])
    return any((one.module, one.resource) in world.slots.values() for one in handlers)


def _has_work(world: World, module: str) -> bool:
    """Whether a module has handlers or slots."""
    handlers = (one for handlers in world.handlers.values() for one in handlers)
    return any(one.module == module for one in handlers) or any(
        place[0] == module for place in world.slots.values()
    )


def leave(world: World, connection: str, *, lost: bool) -> list[Job]:
    """Remove a connection that has left. Return the messages that it was still handling."""
    module = world.modules.pop(connection)
    for key in [key for key in world.waits if key[0] == connection]:
        del world.waits[key]
    for job in [job for job in world.jobs if job.sender == connection and job.kind.has_reply]:
        give_up(world, connection, job.number)
    oracle_locks.left(world, connection)
    is_last = module not in world.modules.values()
    if (is_own := connection not in world.slots) or is_last:
        for message in list(world.handlers):
            remove_handler(world, message, module)
    # A module closes its own connection first, then its slots. Until the last one is closed, queued
    # exception handlers that only this module handled are not skipped.
    if is_own:
        world.spared = oracle_failures.stranded(world)
    world.slots.pop(connection, None)
    if is_last:
        oracle_locks.module_left(world, module)
        world.ended_runs[module] += 1
    if is_last or not _has_work(world, module):
        world.spared.clear()
    orphans = [job for job in world.everything() if job.slot == connection]
    for job in orphans:
        leave_slot(job)
    return orphans


def leave_slot(job: Job) -> None:
    """Apply that a slot no longer has a message."""
    job.slot, job.nested, job.is_postponed, job.frees_slot = "", False, False, False
