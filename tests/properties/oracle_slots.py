"""The rules of resources: a slot handles one message at a time; of those that wait, the one of
highest priority is next, then the one that has waited longest. Those who want to lock or reserve a
resource wait in the same line.
"""

from properties import oracle_failures, oracle_locks, oracle_rules, oracle_taps
from properties.oracle_records import Claim, Collector, Disagreement, Job, Node, World

from tca_wire.journal import facts
from tca_wire.vocabulary import Condition, MessageClass

Resource = tuple[str, str]
Choices = dict[Job | Claim, dict[str, bool]]
"""Who is next: the slots that he may be given to, and whether that is beyond their capacity. A
claim is given to none.
"""


def targets(world: World, job: Job) -> list[Resource]:
    """The resources that may handle a message: the newest handler's, and those of its pool."""
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
    """The slots of each resource that handle nothing."""
    busy = {job.slot for job in world.everything() if job.slot and not job.nested}
    free: dict[Resource, set[str]] = {}
    for slot, resource in world.slots.items():
        if slot not in busy:
            free.setdefault(resource, set()).add(slot)
    return free


def give(world: World) -> bool:
    """Give slots to those who are next, as central did; whether there was anyone. What became
    startable now is started together: only then follows what follows from that. What waited in a
    queue is given one after the other.
    """
    choices = _choices(world)
    if not choices:
        return False
    given = _give_next(world, choices)
    if given is None:
        said = ", ".join(f"{one.id} to {sorted(slots)}" for one, slots in choices.items())
        what = world.seen.given[0] if world.seen.given else "nothing"
        raise Disagreement(f"central gives {what} where these are next: {said}")
    while given is not None and _is_new(world, given):
        given = _give_next(
            world, {one: slots for one, slots in _choices(world).items() if _is_new(world, one)}
        )
    return True


def _is_new(world: World, one: Job | Claim) -> bool:
    return isinstance(one, Job) and one.since == (world.step, world.round)


def give_messages(world: World) -> None:
    """Messages that are no tasks may be given away as they are sent, before anything else
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
    """Deliver or grant what central did next, if that is right; what that is."""
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
    """Who may be delivered next, and to which slots, and who may have a resource for himself."""
    waiting = [
        (job, targets(world, job))
        for job in world.everything()
        if job.waiting and not job.kind.is_monitor
    ]
    free = free_slots(world)
    choices: Choices = {}
    for resource in dict.fromkeys([*free, *(claim.resource for claim in world.claims)]):
        claims = oracle_locks.in_line(world, resource)
        rivals: list[Job | Claim] = [*claims]
        rivals += [
            job
            for job, mine in waiting
            if resource in mine and oracle_locks.lets_in(world, job, resource)
        ]
        for one in rivals:
            if any(_is_before(other, one) for other in rivals):
                continue
            if isinstance(one, Claim) and oracle_locks.may_have_it(world, one):
                choices[one] = {}
            elif not isinstance(one, Claim) and resource in free:
                choices.setdefault(one, {}).update(dict.fromkeys(free[resource], False))
    return choices | _called_back(world, choices, waiting)


def _called_back(
    world: World, choices: Choices, waiting: list[tuple[Job, list[Resource]]]
) -> Choices:
    """Who waits for the answer in a slot itself is called back there, where no other slot is free
    for the question and its resource is not locked. (If slots become free when that lock ends, it
    may be either.)
    """
    asked = [
        job for job, mine in waiting if job.kind.has_reply and world.slots.get(job.sender) in mine
    ]
    return {
        job: {job.sender: True} | choices.get(job, {})
        for job in asked
        if (job not in choices or job.since[0] < world.step)
        and not oracle_locks.is_locked(world, world.slots[job.sender])
    }


def _is_before(one: Job | Claim, other: Job | Claim) -> bool:
    """Whether *one* must be delivered before *other*: by priority, then arrival. What came to wait
    in the course of one event may come in any order, but for tasks that could start at once, and
    claims.
    """
    assert one.arrival is not None
    assert other.arrival is not None
    if isinstance(one, Claim) or isinstance(other, Claim):
        return (-one.priority, one.arrival) < (-other.priority, other.arrival)
    is_same_event = one.since[0] == other.since[0]
    is_same_moment = one.since == other.since and isinstance(one, Node) and isinstance(other, Node)
    if is_same_event and not is_same_moment:
        return False
    if one.priority != other.priority:
        return one.priority > other.priority
    return one.arrival[0] < other.arrival[0]


def _deliver(world: World, job: Job, slot: str, *, nested: bool) -> None:
    world.turns += 1
    job.nested, job.turn = nested, world.turns
    job.slot, job.wanted, job.waiting = slot, False, False
    oracle_taps.happened(world, job, {Condition.WHILE_HANDLING})
    if isinstance(job, Node):
        oracle_rules.started(world, job)


def wait(world: World, job: Job) -> None:
    """What is no task waits as soon as it is sent."""
    job.waiting, job.wanted = True, True
    job.since = (world.step, world.round)
    job.arrival = job.arrival or job.since
    if job not in world.jobs:
        world.jobs.append(job)


def send_statement(world: World, job: Job) -> None:
    """An inform goes to one handler, a broadcast to all."""
    if job.kind is MessageClass.INFORM:
        wait(world, job)
    else:
        copies(world, job)


def copies(world: World, job: Job) -> list[Job]:
    """A copy for each handler that has a slot."""
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
    """A message that is no task came to its end."""
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
    """The sender waits no longer: what nobody handles yet is dropped."""
    world.waits.pop((sender, number), None)
    oracle_locks.give_up(world, sender, number)
    for collector in [
        one for one in world.collectors if (one.sender, one.number) == (sender, number)
    ]:
        world.collectors.remove(collector)
        world.jobs = [job for job in world.jobs if job not in collector.pending or job.slot]
    mine = [
        job
        for job in world.jobs
        if (job.sender, job.number) == (sender, number) and job.kind.has_reply
    ]
    world.jobs = [job for job in world.jobs if job not in mine or job.slot or job.target]


# --- modules come and go --------------------------------------------------------------------------


def remove_handler(world: World, message: str, module: str) -> None:
    """A module handles a message no longer; what was meant for it alone comes to nothing."""
    gone = [one for one in world.handlers.get(message, []) if one.module == module]
    for handler in gone:
        world.handlers[message].remove(handler)
        for job in list(world.jobs):
            if job.message == message and job.target == (module, handler.resource) and job.waiting:
                answered(world, job, done=False)


def is_served(world: World, message: str) -> bool:
    """Whether somebody handles a message and has a slot for it."""
    handlers = world.handlers.get(message, [])
    return any((one.module, one.resource) in world.slots.values() for one in handlers)


def _has_work(world: World, module: str) -> bool:
    """Whether a module handles anything, or has a slot in which something may be at work."""
    handlers = (one for handlers in world.handlers.values() for one in handlers)
    return any(one.module == module for one in handlers) or any(
        place[0] == module for place in world.slots.values()
    )


def leave(world: World, connection: str, *, lost: bool) -> list[Job]:
    """A connection is gone; what it was handling and did not end."""
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
    if (
        is_own
    ):  # what its slots have at work ends first: what waits is spared until a module is gone
        world.spared = oracle_failures.stranded(world)
    world.slots.pop(connection, None)
    if is_last:
        oracle_locks.module_left(world, module)
        world.gone[module] += 1
    if is_last or not _has_work(world, module):
        world.spared.clear()
    orphans = [job for job in world.everything() if job.slot == connection]
    for job in orphans:
        job.slot, job.nested = "", False
    return orphans
