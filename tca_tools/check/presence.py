"""Rules of modules, their handlers, their resources, and locks and reservations."""

from tca_tools.check import lives
from tca_tools.check.records import MessageRecord, ResourceRecord
from tca_tools.check.rules import CAPACITY, GRANTED, HANDLES, PRESENT
from tca_tools.check.world import JournalWorld, place_in_words
from tca_wire.journal import facts


def restarted(world: JournalWorld, fact: facts.CentralRestarted) -> None:
    """Apply a restart of central: no task starts for now."""
    del fact
    world.are_tasks_paused = True


def continued(world: JournalWorld, fact: facts.WentOn) -> None:
    """Apply that central continues: tasks may start again."""
    del fact
    world.are_tasks_paused = False
    world.places_touched.update(dict.fromkeys(world.places.values()))


def joined(world: JournalWorld, fact: facts.ModuleJoined) -> None:
    """Apply that a module joins."""
    if fact.module in world.joined:
        world.report(PRESENT, 0, f"module '{fact.module}' joined, but was already connected")
    world.joined[fact.module] = None


def left(world: JournalWorld, fact: facts.ModuleLeft) -> None:
    """Apply that a module leaves."""
    _check_connected(world, fact.module, "left")
    world.joined.pop(fact.module, None)
    for message, handlers in world.handlers.items():
        if fact.module in handlers:
            world.report(PRESENT, 0, f"module '{fact.module}' left, but still handles {message}")
    for place in world.places.values():
        if place.module == fact.module:
            if place.capacity:
                what = f"left, but {place_in_words(place)} still has capacity {place.capacity}"
                world.report(PRESENT, 0, f"module '{fact.module}' {what}")
            place.capacity = 0 if place.capacity is not None else None
            world.places_touched[place] = None
            world.slots_lost.add(place)


def resource(world: JournalWorld, fact: facts.ResourceChanged) -> None:
    """Apply a change of a resource's capacity: a slot was added or removed."""
    _check_connected(world, fact.module, f"offered resource '{fact.resource}'")
    place = world.place(fact.module, fact.resource)
    before = place.capacity
    if before is None and world.is_whole:
        before = 0
    if before is not None and abs(fact.capacity - before) != 1:
        what = f"has capacity {fact.capacity}, but had {before} before"
        world.report(CAPACITY, 0, f"{place_in_words(place)} {what}")
    if before is None or fact.capacity < before:
        world.slots_lost.add(place)
    place.capacity = fact.capacity


def recalling(world: JournalWorld, fact: facts.Recalling) -> None:
    """Apply that a slot must return its prefetched deliveries, or that it has done so."""
    place = world.place(fact.module, fact.resource)
    place.is_recalling = not fact.is_over
    world.places_touched[place] = None


def format_defined(world: JournalWorld, fact: facts.FormatDefined) -> None:
    """Apply the declaration of a message."""
    world.declared[fact.message] = fact
    lives.declared(world, fact)


def handler(world: JournalWorld, fact: facts.HandlerAdded) -> None:
    """Apply that a module handles a message."""
    _check_connected(world, fact.module, f"handles {fact.message}")
    handlers = world.handlers.setdefault(fact.message, {})
    if fact.module in handlers:
        world.report(HANDLES, 0, f"module '{fact.module}' already handles {fact.message}")
    handlers[fact.module] = fact.resource
    (world.accepting.add if fact.accepts else world.accepting.discard)((fact.message, fact.module))
    _handlers_changed(world, fact.message)


def handler_removed(world: JournalWorld, fact: facts.HandlerRemoved) -> None:
    """Apply that a module stops handling a message."""
    handlers = world.handlers.get(fact.message, {})
    if handlers.pop(fact.module, None) is None and world.is_whole:
        what = f"module '{fact.module}' stopped handling {fact.message}, but did not handle it"
        world.report(HANDLES, 0, what)
    if not handlers:
        world.handlers.pop(fact.message, None)
    _handlers_changed(world, fact.message)


def _handlers_changed(world: JournalWorld, message: str) -> None:
    world.handlers_changed.add(message)
    if ("", "") in world.places:
        world.place("", "")


def _check_connected(world: JournalWorld, module: str, what: str) -> None:
    if world.is_whole and module not in world.joined:
        world.report(PRESENT, 0, f"module '{module}' {what}, but is not connected")


# --- locks and reservations -----------------------------------------------------------------------


def claimed(world: JournalWorld, fact: facts.Claimed) -> None:
    """Apply the request for a lock or reservation."""
    world.new_number(fact.id, "claim")
    world.claims[fact.id] = fact
    world.place(fact.module, fact.resource).claims.waiting[fact.id] = fact
    holder = world.known(fact.origin)
    if holder is not None:
        holder.claims[fact.id] = fact


def granted(world: JournalWorld, fact: facts.Granted) -> None:
    """Apply the grant of a lock or reservation."""
    claim = world.claims.get(fact.id)
    if claim is None:
        _unknown(world, fact.id, "granted")
        return
    place = world.place(claim.module, claim.resource)
    if (other := place.claims.held_by) is not None:
        what = "twice" if other is claim else f"while {other.sender} had it ({{{other.id}}})"
        world.report(GRANTED, claim.origin, f"{claim_in_words(claim)} was granted {what}")
    for one in place.claims.places:
        for item in one.running.values():
            if not _is_own(claim, one, item):  # its handler must be lost with this event
                what = f"was in the resource when {claim_in_words(claim)} was granted"
                _expect_lost(world, item, what)
    place.claims.waiting.pop(fact.id, None)
    place.claims.held_by = claim


def _expect_lost(world: JournalWorld, item: MessageRecord, what: str) -> None:
    world.expect(lambda: item.place is None, GRANTED, item, what)


def _is_own(claim: facts.Claimed, place: ResourceRecord, item: MessageRecord) -> bool:
    """Whether a run is the requesting handler, or the only run of the requesting module."""
    return item.handling_id == claim.origin or (
        claim.sender == place.module and len(place.running) == 1
    )


def claim_ended(world: JournalWorld, fact: facts.ClaimEnded) -> None:
    """Apply that a lock or reservation is released or given up."""
    claim = world.claims.pop(fact.id, None)
    if claim is None:
        _unknown(world, fact.id, "released or given up")
        return
    place = world.place(claim.module, claim.resource)
    place.claims.waiting.pop(fact.id, None)
    if place.claims.held_by is claim:
        place.claims.held_by = None
    holder = world.known(claim.origin)
    if holder is not None:
        holder.claims.pop(fact.id, None)


def _unknown(world: JournalWorld, claim: int, what: str) -> None:
    if world.must_know(claim):
        world.report(GRANTED, 0, f"claim {{{claim}}} was {what}, but does not exist")


def claim_in_words(claim: facts.Claimed) -> str:
    """Return a lock or reservation in words."""
    kind = "reservation" if claim.is_reserved else "lock"
    return f"the {kind} {{{claim.id}}} of '{claim.resource}' by {claim.sender}"
