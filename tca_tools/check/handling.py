"""Rules of queues, handlers, answers, and the capacity and locks of resources."""

from tca_tools.check import lives, rules
from tca_tools.check.failing import failed as failed_task
from tca_tools.check.missions import check_status
from tca_tools.check.order import first_moments, not_met, why_too_early
from tca_tools.check.presence import claim_in_words
from tca_tools.check.records import MessageRecord, ResourceRecord
from tca_tools.check.taps import answered as condition_answered
from tca_tools.check.taps import check_fired
from tca_tools.check.world import JournalWorld, place_in_words
from tca_wire.journal import facts
from tca_wire.messages.failures import REJECTED
from tca_wire.points import START_HANDLING
from tca_wire.vocabulary import Outcome, Role


def queued(world: JournalWorld, fact: facts.Queued) -> None:
    """Record that a message waits for a resource or a handler."""
    item = _check_moved(world, fact, "was queued")
    if item is None:
        return
    if item.waits_at is not None and item.message not in world.handlers_changed:
        world.report(rules.QUEUED, item, f"was already queued for {place_in_words(item.waits_at)}")
    _leave_queue(world, item)
    lives.handler_changed(world, item)
    place = item.waits_at = world.place(fact.module, fact.resource)
    place.waiting[item.handling_id] = item
    if fact.module and world.is_whole and item.message not in world.handlers:
        world.report(
            rules.HANDLES, item, f"was queued for {place_in_words(place)}, but no module handles it"
        )


def _check_moved(
    world: JournalWorld, fact: facts.Queued | facts.Delivered, what: str
) -> MessageRecord | None:
    """Return the message that is queued or delivered, after checking that this is allowed."""
    item = world.delivery(fact, what)
    if item is not None:
        _check_may_start(world, item, what)
        _leave_lost_handler(world, item, what)
    return item


def unqueued(world: JournalWorld, item: MessageRecord, _: facts.Unqueued) -> None:
    """Record that a message leaves its queue without a delivery."""
    if item.waits_at is None:
        if item.place is None and not item.is_incomplete:
            world.report(rules.QUEUED, item, "left a queue, but was in none")
        _leave_lost_handler(world, item, "was returned to central")
        lives.handler_changed(world, item)
    _leave_queue(world, item)


def _leave_queue(world: JournalWorld, item: MessageRecord) -> None:
    if item.waits_at is not None:
        item.waits_at.waiting.pop(item.handling_id, None)
        world.places_touched[item.waits_at] = None
        item.waits_at = None


def delivered(world: JournalWorld, fact: facts.Delivered) -> None:
    """Apply the delivery of a message to a handler."""
    item = _check_moved(world, fact, "was given to a handler")
    place = world.place(fact.module, fact.resource)
    if item is None:
        return
    _leave_queue(world, item)
    item.is_within_wait = fact.is_nested
    _check_destination(world, item, place)
    is_nested = _is_from_inside(item, place) or fact.is_nested
    if world.is_whole and not _is_from_inside(item, place):
        _check_slot(world, item, place, fact)
    item.slot = fact.slot
    (place.nested if is_nested else place.running)[item.handling_id] = item
    lives.handler_changed(world, item, place.module)
    item.place, item.is_begun = place, True
    if item.is_task and not item.message_class.is_monitor:
        if world.are_tasks_paused:
            world.report(rules.RESTARTED, item, "was given to a handler before central continued")
        if item.reached & START_HANDLING and not (item.is_incomplete or item.is_killed):
            check_fired(world, item, START_HANDLING)
        what = "was given to a handler, but did not start"
        world.expect(lambda: item.reached & START_HANDLING, rules.ONE_HANDLER, item, what)


def _check_slot(
    world: JournalWorld, item: MessageRecord, place: ResourceRecord, fact: facts.Delivered
) -> None:
    """Check that a slot has one message, except within a wait."""
    where = f"slot {fact.slot} of {place_in_words(place)}"
    inside = [
        one for one in (*place.running.values(), *place.nested.values()) if one.slot == fact.slot
    ]
    if fact.is_nested and not inside:
        what = f"was given to {where} within a wait, but no handler was there"
        world.report(rules.CAPACITY, item, what)
    others = [one for one in inside if not _is_from_inside(one, place)]
    if others and fact.slot and not fact.is_nested:
        world.report(rules.CAPACITY, item, f"was given to {where}, which has {others[-1]}")


def _check_may_start(world: JournalWorld, item: MessageRecord, what: str) -> None:
    """Check that a message may be queued or given to a handler."""
    if item.is_dropped and not item.is_begun and not item.message_class.keeps_value:
        world.report(rules.ANSWERED, item, f"{what}, though its sender gave up")
    elif item.has_returned and not item.is_task:
        world.report(rules.RETURNED, item, f"{what}, but had been handled before")
    if item.is_task and not item.is_incomplete:
        _check_task_may_start(world, item, what)


def _check_task_may_start(world: JournalWorld, item: MessageRecord, what: str) -> None:
    if item.is_over or item.is_killed:
        how = "it had ended" if item.is_over else "it was killed"
        world.report(rules.KILLED, item, f"{what} after {how}")
    if not item.reached & START_HANDLING:
        for rule, why in why_too_early(world, item, first_moments(item), item.reached):
            world.report(rule, item, f"{what} {why}")
        return
    if item.is_suspended and not item.is_orphan:
        world.report(rules.SUSPENDED, item, f"{what} while it was suspended")
    if item.fallback:
        world.report(rules.REPLACED, item, f"{what}, but {item.fallback} was to replace it")
    if item.has_returned or item.deciding:
        world.report(rules.RETURNED, item, f"{what}, but had been handled before")
    if missing := not_met(item, START_HANDLING):
        world.report(rules.TAPPED, item, f"{what} again before {missing}")


def _leave_lost_handler(world: JournalWorld, item: MessageRecord, what: str) -> None:
    """Check that a message leaves its handler only if that handler is lost."""
    place = item.place
    if place is None:
        return
    if place not in world.slots_lost and world.is_whole:
        world.report(rules.ONE_HANDLER, item, f"{what} while {place_in_words(place)} had it")
    _leave_handler(world, item)


def _check_destination(world: JournalWorld, item: MessageRecord, place: ResourceRecord) -> None:
    handled_in = world.handlers.get(item.message, {}).get(place.module)
    # A slot that is asked for its prefetched deliveries may still start one
    if world.is_whole and handled_in != place.name and not place.is_recalling:
        instead = ", which does not handle it"
        if handled_in:
            instead = f", which handles it in '{handled_in}'"
        world.report(rules.HANDLES, item, f"was given to {place_in_words(place)}{instead}")
    check_locks(world, item, place)


def check_locks(world: JournalWorld, item: MessageRecord, place: ResourceRecord) -> None:
    """Check that a message may enter a resource in spite of locks and reservations."""
    held_by = place.claims.held_by
    if held_by is not None:
        is_own = _is_from_inside(item, place) or item.is_within_wait
        if not (held_by.is_reserved and (item.sent_by in (held_by.sender, "") or is_own)):
            how = "reserved" if held_by.is_reserved else "locked"
            what = f"was given to {place_in_words(place)}, which {held_by.sender} has {how}"
            world.report(rules.LOCKED, item, what)


def _is_from_inside(item: MessageRecord, place: ResourceRecord) -> bool:
    """Whether a message is a query that the resource's own module has sent."""
    return item.message_class.has_reply and item.sender == place.module


def _leave_handler(world: JournalWorld, item: MessageRecord) -> None:
    place, item.place = item.place, None
    if place is not None:
        place.running.pop(item.handling_id, None)
        place.nested.pop(item.handling_id, None)
        place.postponed.pop(item.handling_id, None)
        world.places_touched[place] = None


def postponed(world: JournalWorld, item: MessageRecord, fact: facts.Postponed) -> None:
    """Record that a handler has returned, and replies later. Its slot may be free."""
    place = item.place
    if place is not None and fact.frees_slot:
        place.running.pop(item.handling_id, None)
        place.nested.pop(item.handling_id, None)
        place.postponed[item.handling_id] = item
        world.places_touched[place] = None


def returned(world: JournalWorld, item: MessageRecord, fact: facts.Returned) -> None:
    """Apply the return of a handler."""
    if item.place is None or item.handling_id != fact.id:
        if not item.is_incomplete and (item.handling_id == fact.id or world.is_whole):
            what = f"{world.name(fact.id)} was returned, but no handler had it"
            world.report(rules.RETURNED, item.id, what)
        return
    _leave_handler(world, item)
    if fact.outcome is Outcome.FAILED:
        item.has_returned = item.is_task and item.is_killed
        item.must_fail = True
        what = "was failed by its handler, but no failure was raised"
        world.expect(lambda: not item.must_fail, rules.CAUGHT, item, what)
    elif item.is_task:
        lives.returned(world, item, fact)
        item.has_returned = item.is_killed or not item.is_retry_due
        check_status(world, item, fact)
    else:
        if item.role is Role.CONDITION:
            condition_answered(world, item)
        _check_answered(world, item)


def _known(world: JournalWorld, number: int, what: str) -> MessageRecord | None:
    """Return the message with a number; None if the number is new.

    Central gives a copy a new number when the copy fails without ever being queued.
    """
    if world.first and number > world.newest:
        world.record_number(number)
        return None
    return world.item(number, what)


def failed(world: JournalWorld, fact: facts.Failed) -> None:
    """Apply a failure of a task or message."""
    item = _known(world, fact.id, "failed")
    if item is None:
        return
    if not fact.is_beside:  # the task's own handler has raised it
        if item.place is not None:  # its module was lost, so its handler does not return
            _leave_lost_handler(world, item, f"failed ({fact.failure})")
        elif item.is_task and not _may_fail(world, item, fact.failure):
            world.report(rules.CAUGHT, item, f"failed ({fact.failure}), but no handler had it")
        item.must_fail = False
        _leave_queue(world, item)
    if not item.is_task:
        if item.has_returned:
            world.report(rules.RETURNED, item, "failed, but was already over")
        item.failure = fact.failure
        _check_answered(world, item)
    elif item.is_over:
        world.task(fact.id, "failed")
    else:
        failed_task(world, item, fact)


def _may_fail(world: JournalWorld, task: MessageRecord, failure: str) -> bool:
    """Whether a task without a handler may fail."""
    # Central rejects a task if its handler is busy
    is_rejected = failure == REJECTED and task.begun_in == world.event
    return task.must_fail or task.message_class.is_monitor or task.is_incomplete or is_rejected


def dropped(world: JournalWorld, fact: facts.Dropped) -> None:
    """Record that a message is dropped, since no module handles it or its sender gave up."""
    over = world.over.get(fact.id)
    if over is not None and over.message_class.keeps_value:
        world.over[fact.id] = over._replace(body=b"")  # its value is forgotten
        return
    item = _known(world, fact.id, "was dropped")
    if item is None:
        return
    if item.is_task:
        world.report(rules.KILLED, item, "was dropped, but a task must be killed instead")
    _check_open(world, item, "was dropped")
    item.is_dropped = True
    _leave_queue(world, item)
    if not item.message_class.has_reply or item.original is not None:
        _leave_handler(world, item)
    if item.place is None:
        world.finish(item)


# --- answers --------------------------------------------------------------------------------------


def answered(world: JournalWorld, item: MessageRecord, _: facts.Answered) -> None:
    """Record that the sender of a query got its answer."""
    if item.is_answered:
        world.report(rules.ANSWERED, item, "was answered a second time")
    if item.is_dropped:
        world.report(rules.ANSWERED, item, "was answered, though its sender had given up")
    if item.message_class.asks_one and not item.has_returned and not item.is_incomplete:
        world.report(rules.ANSWERED, item, "was answered before it was handled")
    item.is_answered = True
    world.finish(item)


def awaited(world: JournalWorld, item: MessageRecord, _: facts.Awaited) -> None:
    """Record that the sender of a query waits; the answer must be pending."""
    _check_open(world, item, "was waited for")


def _check_open(world: JournalWorld, item: MessageRecord, what: str) -> None:
    if item.is_answered or item.is_dropped:
        what = f"{what} after its sender had received an answer or given up"
        world.report(rules.ANSWERED, item, what)


def _check_answered(world: JournalWorld, item: MessageRecord) -> None:
    """End a message that was handled or failed. A query must be answered with the same event."""
    item.has_returned = True
    asked = item if item.message_class.asks_one and item.role is not Role.CONDITION else None
    if item.message_class.asks_many and item.original is not None and not item.is_over:
        item.original.copies -= 1
        asked = None if item.original.copies else item.original
    if asked is not None:
        what = f"was handled, but {asked.sender}, which waits, got no answer"
        world.expect(lambda: asked.is_answered or asked.is_dropped, rules.ANSWERED, asked, what)
    world.finish(item)


# --- after all facts of an event ------------------------------------------------------------------


def check_places(world: JournalWorld) -> None:
    """Check the resources that an event touched."""
    for place in world.places_touched:
        if place.capacity is not None:
            _check_capacity(world, place, place.capacity)
        for item in (
            list(place.waiting.values()) if world.handlers_changed and not place.module else ()
        ):
            if world.handlers.get(item.message):
                world.report(rules.FREE, item, "waits for a handler, though there is one")


def _check_capacity(world: JournalWorld, place: ResourceRecord, capacity: int) -> None:
    claims, taken = place.claims, len(place.running)
    if taken > max(capacity, 0):
        where = place_in_words(place)
        what = f"is one too many: {where} handles {capacity} at a time, but has {taken}"
        world.report(rules.CAPACITY, next(reversed(place.running.values())), what)
    if not world.is_whole or not capacity or claims.held_by is not None:
        return
    if claims.waiting:
        is_busy = any(
            one.waiting or one.running or one.nested or one.is_recalling for one in claims.places
        )
        if not is_busy:
            claim = next(iter(claims.waiting.values()))
            what = f"{claim_in_words(claim)} is not granted, though the resource is empty"
            world.report(rules.FREE, claim.origin, what)
    elif (
        place.waiting
        and not world.are_tasks_paused
        and taken + len(place.nested) < capacity
        and not place.is_recalling
    ):
        where = place_in_words(place)
        what = f"waits for {where}, which handles {capacity} at a time and has {taken}"
        world.report(rules.FREE, next(iter(place.waiting.values())), what)
