"""Rules of moments: tasks reach them in order and as soon as possible, and waits end with them."""

from tca_tools.check import rules
from tca_tools.check.failing import handler_ended
from tca_tools.check.order import in_words, next_moments, why_too_early
from tca_tools.check.presence import claim_in_words
from tca_tools.check.records import MessageRecord
from tca_tools.check.taps import check_fired, check_watchers, forget_task
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.messages.failures import REJECTED
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    start_of,
)
from tca_wire.vocabulary import Role
from tca_wire.waits import WaitKind

_REACHED = [f"reached {in_words(moments)}" for moments in range(ALL_MOMENTS + 1)]


def reached(world: JournalWorld, fact: facts.Reached) -> None:
    """Apply that a task reached moments."""
    moments = fact.moments
    item = world.task(fact.task, _REACHED[moments & ALL_MOMENTS])
    if item is None:
        return
    if twice := item.reached & moments:
        world.report(rules.ONCE, item, f"{_REACHED[twice]} a second time")
        moments &= ~twice
    before, item.reached = item.reached, item.reached | moments
    for rule, why in why_too_early(world, item, moments, before):
        world.report(rule, item, f"{_REACHED[moments]} {why}")
    if not (item.is_incomplete or item.is_killed):
        check_fired(world, item, moments)
        if moments & START_HANDLING:
            _started(world, item)
    _update_followers(world, item, moments)


def _started(world: JournalWorld, item: MessageRecord) -> None:
    """Apply that a task started."""
    item.begun_in = world.event
    if item.place is None and not item.message_class.is_monitor:
        what = "started, but no handler has it"
        world.expect(lambda: item.failure == REJECTED, rules.ONE_HANDLER, item, what)


def _update_followers(world: JournalWorld, item: MessageRecord, moments: int) -> None:
    """Update everything that waited for moments that a task reached."""
    for hold, follower in item.followers:
        if hold.needs & moments:
            world.touched[follower] = None
            if hold.due is None and hold.constraint.delay:
                is_void = start_of(hold.needs) & item.never_began
                hold.due = world.now + (0 if is_void else hold.constraint.delay)
    if moments & (START_PLANNING | START_ACHIEVING):
        world.touched.update(dict.fromkeys(item.children.values()))
    if moments & END_PLANNING and item.is_goal and item.parent is not None:
        item.parent.unplanned -= 1
        world.touched[item.parent] = None
    if item.waiters:
        world.later.append(lambda: check_waits(world, item))
    if item.reached == ALL_MOMENTS:
        _ended(world, item)


def _ended(world: JournalWorld, item: MessageRecord) -> None:
    """Apply that a task has ended."""
    if item.parent is not None:
        item.parent.children.pop(item.id, None)
        item.parent.background_monitors -= item.is_background
        world.touched[item.parent] = None
    if item.role is Role.EXCEPTION and not item.is_void:
        handler_ended(world, item)
    forget_task(world, item)
    world.finish(item)


# --- waiters for a moment -------------------------------------------------------------------------


def wait_began(world: JournalWorld, fact: facts.WaitBegan) -> None:
    """Apply the start of a module's wait. A wait for changes of a task must end with the task."""
    waits = world.waits.setdefault(fact.key, [])
    waits.append(fact.moment if fact.awaits is WaitKind.TASK else END_ACHIEVING)
    item = world.items.get(fact.task)
    if item is not None and not item.is_over:
        item.waiters[fact.key] = None
        world.later.append(lambda: check_waits(world, item))
    elif fact.task in world.over or (fact.task and world.item(fact.task, "was waited for")):
        what = f"'{fact.module}' waits for {world.name(fact.task)}, which is over"
        world.expect(lambda: not waits, rules.WAITS, fact.task, what)


def wait_ended(world: JournalWorld, fact: facts.WaitEnded) -> None:
    """Apply the end of a wait: its moment is reached, or the module gave up."""
    waits, item = world.waits.get(fact.key, []), world.items.get(fact.task)
    if not waits:
        if world.is_whole or world.must_know(fact.task):
            what = (
                f"'{fact.module}' ended a wait for {world.name(fact.task)} that it had not started"
            )
            world.report(rules.WAITS, fact.task, what)
        return
    past = next((moment for moment in waits if item is None or item.reached & moment), 0)
    if not past and len(set(waits)) > 1:  # the fact does not say which wait was given up
        waits[:] = [0] * len(waits)
    waits.remove(past or waits[0])
    if not waits:
        del world.waits[fact.key]
        if item is not None:
            item.waiters.pop(fact.key, None)


def check_waits(world: JournalWorld, item: MessageRecord) -> None:
    """Check that no module waits for a moment that is past."""
    for key in item.waiters:
        for moment in world.waits.get(key, ()):
            if item.reached & moment:
                what = f"'{key[0]}' still waits for {in_words(moment)} of {item}, which is past"
                world.report(rules.WAITS, item.id, what)


# --- every task reaches all moments that it can with the same event -------------------------------


def check_settled(world: JournalWorld) -> None:
    """Check that every task touched by this event has reached all moments that it could."""
    for item in world.touched:
        if item.is_over:
            for claim in item.claims.values():
                what = f"has ended, but {claim_in_words(claim)}, which was made for it, has not"
                world.report(rules.GRANTED, item, what)
        elif item.is_task and not item.is_incomplete:
            for moments in next_moments(item):
                if not why_too_early(world, item, moments, item.reached):
                    what = (
                        f"nothing keeps {item} from {in_words(moments)}, but it did not reach that"
                    )
                    world.report(rules.SETTLED, item.id, what)
            if item.background_monitors:
                check_watchers(world, item)
