"""Modules, what they handle, their resources, and locks and reservations of these."""

from tca_tools.check import lives
from tca_tools.check.records import MessageRecord, ResourceRecord
from tca_tools.check.rules import CAPACITY, GRANTED, HANDLES, PRESENT
from tca_tools.check.world import JournalWorld, said
from tca_wire.journal import facts


def restarted(world: JournalWorld, fact: facts.CentralRestarted) -> None:
    """Central is back."""
    del fact
    world.is_holding = True


def went_on(world: JournalWorld, fact: facts.WentOn) -> None:
    """What was held back may begin."""
    del fact
    world.is_holding = False
    world.places_touched.update(dict.fromkeys(world.places.values()))


def joined(world: JournalWorld, fact: facts.ModuleJoined) -> None:
    """A module joins."""
    if fact.module in world.joined:
        world.broken(PRESENT, 0, f"module '{fact.module}' joined, and is there already")
    world.joined[fact.module] = None


def left(world: JournalWorld, fact: facts.ModuleLeft) -> None:
    """A module leaves."""
    _must_be_there(world, fact.module, "left")
    world.joined.pop(fact.module, None)
    for message, handlers in world.handlers.items():
        if fact.module in handlers:
            world.broken(PRESENT, 0, f"module '{fact.module}' left, and still handles {message}")
    for place in world.places.values():
        if place.module == fact.module:
            if place.capacity:
                world.broken(
                    PRESENT,
                    0,
                    f"module '{fact.module}' left, and {said(place)} still takes {place.capacity}",
                )
            place.capacity = 0 if place.capacity is not None else None
            world.places_touched[place] = None
            world.slots_lost.add(place)


def resource(world: JournalWorld, fact: facts.ResourceChanged) -> None:
    """The capacity of a resource changes: a slot came, or is gone."""
    _must_be_there(world, fact.module, f"offered resource '{fact.resource}'")
    place = world.place(fact.module, fact.resource)
    before = place.capacity if place.capacity is not None else 0 if world.is_whole else None
    if before is not None and abs(fact.capacity - before) != 1:
        world.broken(
            CAPACITY, 0, f"{said(place)} takes {fact.capacity} at a time, and took {before} before"
        )
    if before is None or fact.capacity < before:
        world.slots_lost.add(place)
    place.capacity = fact.capacity


def recalling(world: JournalWorld, fact: facts.Recalling) -> None:
    """A slot is to give back what it has ahead, or has."""
    place = world.place(fact.module, fact.resource)
    place.is_recalling = not fact.is_over
    world.places_touched[place] = None


def format_defined(world: JournalWorld, fact: facts.FormatDefined) -> None:
    """A message is declared."""
    world.declared[fact.message] = fact
    lives.declared(world, fact)


def handler(world: JournalWorld, fact: facts.HandlerAdded) -> None:
    """A module handles a message."""
    _must_be_there(world, fact.module, f"handles {fact.message}")
    handlers = world.handlers.setdefault(fact.message, {})
    if fact.module in handlers:
        world.broken(HANDLES, 0, f"module '{fact.module}' handles {fact.message} already")
    handlers[fact.module] = fact.resource
    (world.accepting.add if fact.accepts else world.accepting.discard)((fact.message, fact.module))
    _handlers_changed(world, fact.message)


def no_handler(world: JournalWorld, fact: facts.HandlerRemoved) -> None:
    """A module stops handling a message."""
    handlers = world.handlers.get(fact.message, {})
    if handlers.pop(fact.module, None) is None and world.is_whole:
        world.broken(
            HANDLES,
            0,
            f"module '{fact.module}' handles {fact.message} no longer, and did not before",
        )
    if not handlers:
        world.handlers.pop(fact.message, None)
    _handlers_changed(world, fact.message)


def _handlers_changed(world: JournalWorld, message: str) -> None:
    world.rehandled.add(message)
    if ("", "") in world.places:
        world.place("", "")


def _must_be_there(world: JournalWorld, module: str, what: str) -> None:
    if world.is_whole and module not in world.joined:
        world.broken(PRESENT, 0, f"module '{module}' {what}, and is not there")


# --- locks and reservations -----------------------------------------------------------------------


def claimed(world: JournalWorld, fact: facts.Claimed) -> None:
    """A module asks for a lock or reservation."""
    world.new_number(fact.id, "claim")
    world.claims[fact.id] = fact
    world.place(fact.module, fact.resource).claims.waiting[fact.id] = fact
    holder = world.known(fact.origin)
    if holder is not None:
        holder.claims[fact.id] = fact


def granted(world: JournalWorld, fact: facts.Granted) -> None:
    """A lock or reservation is granted."""
    claim = world.claims.get(fact.id)
    if claim is None:
        _unknown(world, fact.id, "granted")
        return
    place = world.place(claim.module, claim.resource)
    if (other := place.claims.held_by) is not None:
        what = "twice" if other is claim else f"while {other.sender} had it ({{{other.id}}})"
        world.broken(GRANTED, claim.origin, f"{claim_in_words(claim)} was granted {what}")
    for one in place.claims.places:
        for item in one.runs.values():
            if not _is_own(claim, one, item):  # it must have lost its handler with the same event
                what = f"was in it when {claim_in_words(claim)} was granted"
                world.expect(lambda item=item: item.place is None, GRANTED, item, what)  # type: ignore[misc]
    place.claims.waiting.pop(fact.id, None)
    place.claims.held_by = claim


def _is_own(claim: facts.Claimed, place: ResourceRecord, item: MessageRecord) -> bool:
    """Whether the resource is used by the module that asks; of nested handlers only the module is
    known.
    """
    return item.handling_id == claim.origin or (
        claim.sender == place.module and len(place.runs) == 1
    )


def claim_ended(world: JournalWorld, fact: facts.ClaimEnded) -> None:
    """A lock or reservation is released, or given up."""
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
        world.broken(
            GRANTED, 0, f"claim {{{claim}}} was {what}, and there is no such lock or reservation"
        )


def claim_in_words(claim: facts.Claimed) -> str:
    """A lock or reservation."""
    kind = "reservation" if claim.is_reserved else "lock"
    return f"the {kind} {{{claim.id}}} of '{claim.resource}' by {claim.sender}"
