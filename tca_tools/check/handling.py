"""Messages on their way: queued, given to one handler, returned; and the capacity and locks of
resources.
"""

from tca_tools.check import lives, rules
from tca_tools.check.failing import failed as failed_task
from tca_tools.check.missions import check_status
from tca_tools.check.order import first_moments, not_met, too_early
from tca_tools.check.presence import claim_in_words
from tca_tools.check.records import MessageRecord, ResourceRecord
from tca_tools.check.taps import answered as condition_answered
from tca_tools.check.taps import check_fired
from tca_tools.check.world import JournalWorld, said
from tca_wire.journal import facts
from tca_wire.messages.failures import REJECTED
from tca_wire.points import START_HANDLING
from tca_wire.vocabulary import Outcome, Role


def queued(world: JournalWorld, fact: facts.Queued) -> None:
    """A message waits for a resource, or for a handler."""
    item = _moved(world, fact, "was queued")
    if item is None:
        return
    if item.waits_at is not None and item.message not in world.rehandled:
        world.broken(rules.QUEUED, item, f"was queued for {said(item.waits_at)} already")
    _leave_queue(world, item)
    lives.go_on(world, item)
    place = item.waits_at = world.place(fact.module, fact.resource)
    place.waiting[item.handling_id] = item
    if fact.module and world.is_whole and item.message not in world.handlers:
        world.broken(rules.HANDLES, item, f"was queued for {said(place)}, and nobody handles it")


def _moved(
    world: JournalWorld, fact: facts.Queued | facts.Delivered, what: str
) -> MessageRecord | None:
    """The message that is queued or given to a handler; it may be so, and leaves a handler that is
    lost.
    """
    item = world.delivery(fact, what)
    if item is not None:
        _may_be_begun(world, item, what)
        _leave_lost(world, item, what)
    return item


def unqueued(world: JournalWorld, item: MessageRecord, _: facts.Unqueued) -> None:
    """A message leaves its queue, and no handler gets it."""
    if item.waits_at is None:
        if item.place is None and not item.is_stranger:
            world.broken(rules.QUEUED, item, "left a queue in which it was not")
        _leave_lost(world, item, "was taken back")
        lives.go_on(world, item)
    _leave_queue(world, item)


def _leave_queue(world: JournalWorld, item: MessageRecord) -> None:
    if item.waits_at is not None:
        item.waits_at.waiting.pop(item.handling_id, None)
        world.places_touched[item.waits_at] = None
        item.waits_at = None


def delivered(world: JournalWorld, fact: facts.Delivered) -> None:
    """A handler gets a message."""
    item = _moved(world, fact, "was given to a handler")
    place = world.place(fact.module, fact.resource)
    if item is None:
        return
    _leave_queue(world, item)
    _may_go_to(world, item, place)
    is_nested = item.message_class.has_reply and item.sender == place.module
    (place.nested if is_nested else place.runs)[item.handling_id] = item
    lives.go_on(world, item, place.module)
    item.place, item.is_begun = place, True
    if item.is_task and not item.message_class.is_monitor:
        if world.is_holding:
            world.broken(rules.RESTARTED, item, "was given to a handler before central went on")
        if item.reached & START_HANDLING and not (item.is_stranger or item.is_killed):
            check_fired(world, item, START_HANDLING)
        what = "was given to a handler, and was not begun"
        world.expect(lambda: item.reached & START_HANDLING, rules.ONE_HANDLER, item, what)


def _may_be_begun(world: JournalWorld, item: MessageRecord, what: str) -> None:
    """Check that nothing keeps a message from being given to a handler."""
    if item.is_dropped and not item.is_begun and not item.message_class.keeps_value:
        world.broken(rules.ANSWERED, item, f"{what}, though its sender gave up")
    elif item.returned and not item.is_task:
        world.broken(rules.RETURNED, item, f"{what}, and was handled before")
    if item.is_task and not item.is_stranger:
        _task_may_be_begun(world, item, what)


def _task_may_be_begun(world: JournalWorld, item: MessageRecord, what: str) -> None:
    if item.is_over or item.is_killed:
        world.broken(
            rules.KILLED, item, f"{what}, and {'is over' if item.is_over else 'is killed'}"
        )
    if not item.reached & START_HANDLING:
        for rule, why in too_early(world, item, first_moments(item), item.reached):
            world.broken(rule, item, f"{what} {why}")
        return
    if item.is_suspended and not item.is_orphan:
        world.broken(rules.SUSPENDED, item, f"{what} while it was suspended")
    if item.returned or item.deciding:
        world.broken(rules.RETURNED, item, f"{what}, and was handled before")
    if missing := not_met(item, START_HANDLING):
        world.broken(rules.TAPPED, item, f"{what} once more before {missing}")


def _leave_lost(world: JournalWorld, item: MessageRecord, what: str) -> None:
    """Check that a message leaves its handler only if that handler is lost."""
    place = item.place
    if place is None:
        return
    if place not in world.slots_lost and world.is_whole:
        world.broken(rules.ONE_HANDLER, item, f"{what} while {said(place)} had it")
    _end_run(world, item)


def _may_go_to(world: JournalWorld, item: MessageRecord, place: ResourceRecord) -> None:
    handled_in = world.handlers.get(item.message, {}).get(place.module)
    if world.is_whole and handled_in != place.name and not place.is_recalling:  # it had it ahead
        instead = (
            f", which handles it in '{handled_in}'" if handled_in else ", which does not handle it"
        )
        world.broken(rules.HANDLES, item, f"was given to {said(place)}{instead}")
    check_locks(world, item, place)


def check_locks(world: JournalWorld, item: MessageRecord, place: ResourceRecord) -> None:
    """Check that a message may go where others have locks or reservations."""
    held_by = place.claims.held_by
    if held_by is not None:
        is_own = item.message_class.has_reply and item.sender == place.module
        if not (held_by.is_reserved and (item.sent_by in (held_by.sender, "") or is_own)):
            how = "reserved" if held_by.is_reserved else "locked"
            world.broken(
                rules.LOCKED, item, f"was given to {said(place)}, which {held_by.sender} has {how}"
            )


def _end_run(world: JournalWorld, item: MessageRecord) -> None:
    place, item.place = item.place, None
    if place is not None:
        place.runs.pop(item.handling_id, None)
        place.nested.pop(item.handling_id, None)
        world.places_touched[place] = None


def returned(world: JournalWorld, item: MessageRecord, fact: facts.Returned) -> None:
    """A handler returns."""
    if item.place is None or item.handling_id != fact.id:
        if not item.is_stranger and (item.handling_id == fact.id or world.is_whole):
            world.broken(
                rules.RETURNED,
                item.id,
                f"{world.name(fact.id)} was returned, and no handler had it",
            )
        return
    _end_run(world, item)
    if fact.outcome is Outcome.FAILED:
        item.returned = item.is_task and item.is_killed
        item.must_fail = True
        what = "was failed by its handler, and no failure was raised"
        world.expect(lambda: not item.must_fail, rules.CAUGHT, item, what)
    elif item.is_task:
        item.returned = item.is_killed or not item.again
        check_status(world, item, fact)
    else:
        if item.role is Role.CONDITION:
            condition_answered(world, item)
        _must_answer(world, item)


def _known(world: JournalWorld, number: int, what: str) -> MessageRecord | None:
    """The message of that number; a new one is a copy that came to nothing before it was queued
    anywhere.
    """
    if world.first and number > world.newest:
        world.note_number(number)
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
        elif item.is_task and not _may_fail(world, item, fact.failure):
            world.broken(rules.CAUGHT, item, f"failed ({fact.failure}), and no handler had it")
        item.must_fail = False
        _leave_queue(world, item)
    if not item.is_task:
        if item.returned:
            world.broken(rules.RETURNED, item, "failed, and was over before")
        item.failure = fact.failure
        _must_answer(world, item)
    elif item.is_over:
        world.task(fact.id, "failed")
    else:
        failed_task(world, item, fact)


def _may_fail(world: JournalWorld, task: MessageRecord, failure: str) -> bool:
    """Whether a task that no handler has may fail."""
    is_rejected = (
        failure == REJECTED and task.begun_in == world.event
    )  # by central: its handler is busy
    return task.must_fail or task.message_class.is_monitor or task.is_stranger or is_rejected


def dropped(world: JournalWorld, fact: facts.Dropped) -> None:
    """A message is dropped: nobody handles it, or nobody waits for it any more."""
    over = world.over.get(fact.id)
    if over is not None and over.message_class.keeps_value:
        world.over[fact.id] = over._replace(body=b"")  # its value is forgotten
        return
    item = _known(world, fact.id, "was dropped")
    if item is None:
        return
    if item.is_task:
        world.broken(rules.KILLED, item, "was dropped: a task is killed instead")
    _must_be_open(world, item, "was dropped")
    item.is_dropped = True
    _leave_queue(world, item)
    if not item.message_class.has_reply or item.original is not None:
        _end_run(world, item)
    if item.place is None:
        world.finish(item)


# --- answers --------------------------------------------------------------------------------------


def answered(world: JournalWorld, item: MessageRecord, _: facts.Answered) -> None:
    """The sender of a query gets its answer."""
    if item.is_answered:
        world.broken(rules.ANSWERED, item, "was answered a second time")
    if item.is_dropped:
        world.broken(rules.ANSWERED, item, "was answered, though nobody waited any more")
    if item.message_class.asks_one and not item.returned and not item.is_stranger:
        world.broken(rules.ANSWERED, item, "was answered before it was handled")
    item.is_answered = True
    world.finish(item)


def awaited(world: JournalWorld, item: MessageRecord, _: facts.Awaited) -> None:
    """The sender of a query begins to wait; the answer must still be to come."""
    _must_be_open(world, item, "was waited for")


def _must_be_open(world: JournalWorld, item: MessageRecord, what: str) -> None:
    if item.is_answered or item.is_dropped:
        what = f"{what} after its sender had got an answer, or given up"
        world.broken(rules.ANSWERED, item, what)


def _must_answer(world: JournalWorld, item: MessageRecord) -> None:
    """A query was handled, or failed: its sender is told with the same event."""
    item.returned = True
    asked = item if item.message_class.asks_one and item.role is not Role.CONDITION else None
    if item.message_class.asks_many and item.original is not None and not item.is_over:
        item.original.copies -= 1
        asked = None if item.original.copies else item.original
    if asked is not None:
        what = f"was handled, and {asked.sender}, which waits, was not answered"
        world.expect(lambda: asked.is_answered or asked.is_dropped, rules.ANSWERED, asked, what)
    world.finish(item)


# --- when all of an event is known ----------------------------------------------------------------


def check_places(world: JournalWorld) -> None:
    """Check the resources that this event touched."""
    for place in world.places_touched:
        if place.capacity is not None:
            _check_capacity(world, place, place.capacity)
        for item in list(place.waiting.values()) if world.rehandled and not place.module else ():
            if world.handlers.get(item.message):
                world.broken(rules.FREE, item, "waits for a handler, and has one")


def _check_capacity(world: JournalWorld, place: ResourceRecord, capacity: int) -> None:
    claims, taken = place.claims, len(place.runs)
    if taken > max(capacity, 0):
        what = f"is one too many: {said(place)} takes {capacity} at a time, and has {taken}"
        world.broken(rules.CAPACITY, next(reversed(place.runs.values())), what)
    if not world.is_whole or not capacity or claims.held_by is not None:
        return
    if claims.waiting:
        if not any(
            one.waiting or one.runs or one.nested or one.is_recalling for one in claims.places
        ):
            claim = next(iter(claims.waiting.values()))
            world.broken(
                rules.FREE,
                claim.origin,
                f"{claim_in_words(claim)} is not granted, and nobody is in there",
            )
    elif (
        place.waiting
        and not world.is_holding
        and taken + len(place.nested) < capacity
        and not place.is_recalling
    ):
        what = f"waits for {said(place)}, which takes {capacity} and has {taken}"
        world.broken(rules.FREE, next(iter(place.waiting.values())), what)
