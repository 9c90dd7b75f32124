"""Messages on their way: queued, given to one handler, returned; and the capacity and locks of resources."""

from itertools import islice

from tca_tools.check.asking import must_answer
from tca_tools.check.births import not_met, not_startable
from tca_tools.check.failing import failed as failed_task
from tca_tools.check.records import MessageRecord, ResourceRecord
from tca_tools.check.rules import (
    ANSWERED,
    CAPACITY,
    CAUGHT,
    CONSTRAINT,
    FAMILY,
    FREE,
    HANDLES,
    KILLED,
    LOCKED,
    ONE_HANDLER,
    QUEUED,
    RETURNED,
    SUSPENDED,
    TAPPED,
)
from tca_tools.check.taps import answered as condition_answered
from tca_tools.check.taps import check_fired
from tca_tools.check.world import JournalWorld, said
from tca_wire.journal import facts
from tca_wire.points import START_ACHIEVING, START_HANDLING, START_PLANNING
from tca_wire.vocabulary import Outcome, Role

_NAMED = 6
"""Messages of a resource that a violation names."""


def queued(world: JournalWorld, fact: facts.Queued) -> None:
    """A message waits for a resource, or for a handler."""
    item = world.delivery(fact, "was queued")
    if item is None:
        return
    _may_be_begun(world, item, "was queued")
    _leave_lost(world, item, "was queued")
    if item.waits_at is not None and item.message not in world.rehandled:
        world.broken(QUEUED, item.id, f"{item} was queued for {said(item.waits_at)} already")
    _leave_queue(world, item)
    place = item.waits_at = world.place(fact.module, fact.resource)
    place.waiting[item.given_as] = item
    if fact.module and world.is_whole and item.message not in world.handlers:
        world.broken(HANDLES, item.id, f"{item} was queued for {said(place)}, and nobody handles it")


def unqueued(world: JournalWorld, fact: facts.Unqueued) -> None:
    """A message leaves its queue, and no handler gets it."""
    item = world.item(fact.id, "left a queue")
    if item is None:
        return
    if item.waits_at is None:
        if item.place is None and not item.is_stranger:
            world.broken(QUEUED, item.id, f"{item} left a queue in which it was not")
        _leave_lost(world, item, "was taken back")
    _leave_queue(world, item)


def _leave_queue(world: JournalWorld, item: MessageRecord) -> None:
    if item.waits_at is not None:
        item.waits_at.waiting.pop(item.given_as, None)
        world.places_touched[item.waits_at] = None
        item.waits_at = None


def delivered(world: JournalWorld, fact: facts.Delivered) -> None:
    """A handler gets a message."""
    item = world.delivery(fact, "was delivered")
    place = world.place(fact.module, fact.resource)
    if item is None:
        return
    _may_be_begun(world, item, "was given to a handler")
    _leave_lost(world, item, "was given to a handler")
    _leave_queue(world, item)
    _may_go_to(world, item, place)
    is_nested = item.message_class.has_reply and item.sender == place.module
    (place.nested if is_nested else place.runs)[item.given_as] = item
    item.place, item.is_begun = place, True
    if item.is_task and not item.message_class.is_monitor:
        if item.reached & START_HANDLING and not (item.is_stranger or item.is_killed):
            check_fired(world, item, START_HANDLING)
        world.later.append(lambda: _check_begun(world, item))


def _check_begun(world: JournalWorld, item: MessageRecord) -> None:
    if not item.reached & START_HANDLING:
        world.broken(ONE_HANDLER, item.id, f"{item} was given to a handler, and was not begun")


def _may_be_begun(world: JournalWorld, item: MessageRecord, what: str) -> None:
    """Check that nothing keeps a message from being given to a handler."""
    if item.is_dropped and not item.is_begun and not item.message_class.keeps_value:
        world.broken(ANSWERED, item.id, f"{item} {what}, though its sender gave up")
    elif item.returned and not item.is_task:
        world.broken(RETURNED, item.id, f"{item} {what}, and was handled before")
    if item.is_task and not item.is_stranger:
        _task_may_be_begun(world, item, what)


def _task_may_be_begun(world: JournalWorld, item: MessageRecord, what: str) -> None:
    if item.is_over or item.is_killed:
        world.broken(KILLED, item.id, f"{item} {what}, and {'is over' if item.is_over else 'is killed'}")
    elif item.is_suspended and not item.is_orphan:
        world.broken(SUSPENDED, item.id, f"{item} {what} while it is suspended")
    if item.reached & START_HANDLING:
        if item.returned or item.deciding:
            world.broken(RETURNED, item.id, f"{item} {what}, and was handled before")
        if missing := not_met(item, START_HANDLING):
            world.broken(TAPPED, item.id, f"{item} {what} once more before {missing}")
        return
    start = START_PLANNING if item.is_goal else START_ACHIEVING
    if missing := not_startable(item):
        world.broken(CONSTRAINT, item.id, f"{item} {what} before {missing}")
    if item.parent is not None and not item.role and not item.parent.reached & start:
        world.broken(FAMILY, item.id, f"{item} {what} before {item.parent}, under which it is, was begun")


def _leave_lost(world: JournalWorld, item: MessageRecord, what: str) -> None:
    """Check that a message leaves its handler only if that handler is lost."""
    place = item.place
    if place is None:
        return
    if place not in world.slots_lost and world.is_whole:
        world.broken(ONE_HANDLER, item.id, f"{item} {what} while {said(place)} had it")
    end_run(world, item)


def _may_go_to(world: JournalWorld, item: MessageRecord, place: ResourceRecord) -> None:
    handled_in = world.handlers.get(item.message, {}).get(place.module)
    if world.is_whole and handled_in != place.name:
        instead = f", which handles it in '{handled_in}'" if handled_in else ", which does not handle it"
        world.broken(HANDLES, item.id, f"{item} was given to {said(place)}{instead}")
    held_by = place.claims.held_by
    if held_by is not None:
        is_own = item.message_class.has_reply and item.sender == place.module
        if not (held_by.is_reserved and (item.sent_by in (held_by.sender, "") or is_own)):
            how = "reserved" if held_by.is_reserved else "locked"
            world.broken(LOCKED, item.id, f"{item} was given to {said(place)}, which {held_by.sender} has {how}")


def end_run(world: JournalWorld, item: MessageRecord) -> None:
    """Take a message away from its handler."""
    place, item.place = item.place, None
    if place is not None:
        place.runs.pop(item.given_as, None)
        place.nested.pop(item.given_as, None)
        world.places_touched[place] = None


def returned(world: JournalWorld, fact: facts.Returned) -> None:
    """A handler returns."""
    item = world.item(fact.id, "was returned")
    if item is None:
        return
    if item.place is None or item.given_as != fact.id:
        if not item.is_stranger and (item.given_as == fact.id or world.is_whole):
            world.broken(RETURNED, item.id, f"{world.name(fact.id)} was returned, and no handler had it")
        return
    end_run(world, item)
    if fact.outcome is Outcome.FAILED:
        item.returned = item.is_task and item.is_killed
        item.must_fail = True
        world.later.append(lambda: _check_failed(world, item))
    elif item.is_task:
        item.returned = item.is_killed or not item.again
    else:
        if item.role is Role.CONDITION:
            condition_answered(world, item)
        must_answer(world, item)


def _check_failed(world: JournalWorld, item: MessageRecord) -> None:
    if item.must_fail:
        world.broken(CAUGHT, item.id, f"the handler of {item} failed, and no failure was raised")


def _known(world: JournalWorld, number: int, what: str) -> MessageRecord | None:
    """The message of that number; a new one is a copy that came to nothing before it was queued anywhere."""
    if world.first and number > world.newest:
        world.new_number(number)
        return None
    return world.item(number, what)


def failed(world: JournalWorld, fact: facts.Failed) -> None:
    """A failure is raised on a task or message."""
    item = _known(world, fact.id, "failed")
    if item is None:
        return
    if not fact.is_beside:
        if item.place is not None:  # of a module that was lost no handler returns
            _leave_lost(world, item, f"failed ({fact.failure})")
        elif item.is_task and not (item.must_fail or item.message_class.is_monitor or item.is_stranger):
            world.broken(CAUGHT, item.id, f"{item} failed ({fact.failure}), and no handler had it")
        item.must_fail = False
        _leave_queue(world, item)
    if not item.is_task:
        if item.returned:
            world.broken(RETURNED, item.id, f"{item} failed, and was over before")
        item.failure = fact.failure
        must_answer(world, item)
    elif item.is_over:
        world.task(fact.id, "failed")
    else:
        failed_task(world, item, fact)


def dropped(world: JournalWorld, fact: facts.Dropped) -> None:
    """A message is dropped: nobody handles it, or nobody waits for it any more."""
    if fact.id in world.over and world.over[fact.id].message_class.keeps_value:
        return  # its value is forgotten
    item = _known(world, fact.id, "was dropped")
    if item is None:
        return
    if item.is_task:
        world.broken(KILLED, item.id, f"{item} was dropped: a task is killed instead")
    if item.is_dropped or item.is_answered:
        world.broken(ANSWERED, item.id, f"{item} was dropped after its sender had got an answer, or given up")
    item.is_dropped = True
    _leave_queue(world, item)
    if not item.message_class.has_reply or item.original is not None:
        end_run(world, item)
    if item.place is None:
        world.finish(item)


# --- when all of an event is known -----------------------------------------------------------------------------------


def check_places(world: JournalWorld) -> None:
    """Check the resources that this event touched."""
    for place in world.places_touched:
        if not place.module:
            _check_unhandled(world, place)
        elif place.capacity is not None:
            _check_capacity(world, place, place.capacity)


def _check_capacity(world: JournalWorld, place: ResourceRecord, capacity: int) -> None:
    if len(place.runs) > capacity:
        names = ", ".join(map(str, islice(place.runs.values(), _NAMED)))
        names += f" and {len(place.runs) - _NAMED} more" if len(place.runs) > _NAMED else ""
        last = next(reversed(place.runs.values()))
        world.broken(CAPACITY, last.id, f"{said(place)} takes {capacity} at a time, and has {len(place.runs)}: {names}")
    claims = place.claims
    is_empty = bool(capacity) and not any(one.waiting or one.runs or one.nested for one in claims.places)
    if is_empty and claims.waiting and claims.held_by is None and world.is_whole:
        claim = next(iter(claims.waiting.values()))
        world.broken(FREE, claim.origin, f"{claim.sender} waits to lock or reserve {said(place)}, and nobody is in it")
    if not (place.waiting and world.is_whole) or len(place.runs) + len(place.nested) >= capacity:
        return
    first = next(iter(place.waiting.values()))
    if claims.held_by is None and not claims.waiting:
        what = f"{first} waits for {said(place)}, which takes {capacity} and has {len(place.runs)}"
        world.broken(FREE, first.id, what)


def _check_unhandled(world: JournalWorld, place: ResourceRecord) -> None:
    """Check that messages without a handler really have none."""
    for item in list(place.waiting.values()) if world.rehandled else ():
        if world.handlers.get(item.message):
            world.broken(FREE, item.id, f"{item} waits for a handler, and has one")
