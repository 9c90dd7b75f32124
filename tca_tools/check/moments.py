"""The order of moments: within a task, by constraints, after the parent's starts and the children's ends."""

from tca_tools.check import lives, rules
from tca_tools.check.births import is_delayed, not_met, not_startable
from tca_tools.check.failing import handler_ended
from tca_tools.check.presence import claim_in_words
from tca_tools.check.records import MessageRecord
from tca_tools.check.taps import check_fired, check_watchers, forget_task
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.messages.failures import REJECTED
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    describe_moments,
    start_of,
)
from tca_wire.rules import PARENT_FIRST, rules_of
from tca_wire.vocabulary import Role
from tca_wire.waits import WaitKind

_REACHED = [f"reached {', '.join(describe_moments(moments))}" for moments in range(ALL_MOMENTS + 1)]


def reached(world: JournalWorld, fact: facts.Reached) -> None:
    """A task reaches moments."""
    moments = fact.moments
    item = world.task(fact.task, _REACHED[moments & ALL_MOMENTS])
    if item is None:
        return
    if twice := item.reached & moments:
        world.broken(rules.ONCE, item, f"reached {_words(twice)} a second time")
        moments &= ~twice
    before, item.reached = item.reached, item.reached | moments
    if not item.is_stranger:
        _check_order(world, item, moments)
        if not item.is_killed:
            _check_starts(world, item, moments, before)
            check_fired(world, item, moments)
    if moments & (END_HANDLING | END_PLANNING | END_ACHIEVING):
        _check_ends(world, item, moments)
    _go_on(world, item, moments)


def _go_on(world: JournalWorld, item: MessageRecord, moments: int) -> None:
    """Tell those that waited for these moments."""
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
        _end(world, item)


def _words(moments: int) -> str:
    return ", ".join(describe_moments(moments))


def _check_order(world: JournalWorld, item: MessageRecord, moments: int) -> None:
    for moment, needed in rules_of(item.is_goal).no_later.items():
        if moments & moment and (missing := (needed | rules_of(item.is_goal).at_birth) & ~item.reached):
            rule = rules.COMMAND if moment in (START_HANDLING, START_ACHIEVING, START_PLANNING) else rules.ORDER
            world.broken(rule, item, f"reached {_words(moment)} before {_words(missing)}")


def _check_starts(world: JournalWorld, item: MessageRecord, moments: int, before: int) -> None:
    if missing := not_met(item, moments):
        world.broken(rules.CONSTRAINT, item, f"reached {_words(moments)} before {missing}")
    parent = item.parent
    starts = PARENT_FIRST & ~rules_of(item.is_goal).at_birth
    if parent is not None and not item.role and (early := moments & starts & ~parent.reached):
        world.broken(rules.FAMILY, item, f"reached {_words(early)} before {parent}, under which it is, did")
    if moments & START_HANDLING:
        if item.is_suspended and not item.is_orphan:
            world.broken(rules.SUSPENDED, item, "was begun while it was suspended")
        if item.place is None and not item.message_class.is_monitor:
            what = "was begun, and no handler has it"
            world.expect(lambda: item.failure == REJECTED, rules.ONE_HANDLER, item, what)
        item.begun_in = world.event
    if moments & END_HANDLING and before & START_HANDLING:
        _check_handled(world, item)


def _check_handled(world: JournalWorld, item: MessageRecord) -> None:
    """Check that the handler has returned and its failure has been dealt with."""
    if item.deciding:
        what = f"was handled while {world.name(item.deciding)} had not dealt with its failure"
        world.broken(rules.RECOVERED, item, what)
    elif item.again:
        world.broken(rules.SETTLED, item, "was handled, and is to be handled again")
    elif not item.returned and not (item.message_class.is_monitor and item.begun_in == world.event):
        world.broken(rules.RETURNED, item, "was handled, and its handler has not returned")


def _check_ends(world: JournalWorld, item: MessageRecord, moments: int) -> None:
    if item.place is not None:
        world.broken(rules.ONE_HANDLER, item, f"reached {_words(moments)} while a handler had it")
    if moments & END_ACHIEVING and item.children:
        child = next(iter(item.children.values()))
        world.broken(rules.FAMILY, item, f"ended before {child}, which is under it")
    elif moments & END_PLANNING and item.unplanned and item.is_goal:
        late = next(child for child in item.children.values() if child.is_goal and not child.reached & END_PLANNING)
        world.broken(rules.FAMILY, item, f"was planned before {late}, which is under it")


def _end(world: JournalWorld, item: MessageRecord) -> None:
    """A task has ended."""
    lives.end(world, item)
    if item.parent is not None:
        item.parent.children.pop(item.id, None)
        item.parent.watchers -= item.is_watcher
        world.touched[item.parent] = None
    if item.role is Role.EXCEPTION and not item.is_void:
        handler_ended(world, item)
    forget_task(world, item)
    world.finish(item)


# --- waiters for a moment --------------------------------------------------------------------------------------------


def wait_began(world: JournalWorld, fact: facts.WaitBegan) -> None:
    """A module waits for a moment of a task; or for changes, which its end is at the latest; or for other things."""
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
    """A wait is over: its moment is reached, or the module gave up."""
    waits, item = world.waits.get(fact.key, []), world.items.get(fact.task)
    if not waits:
        if world.is_whole or (world.first and fact.task >= world.first):
            what = f"'{fact.module}' waits no longer for {world.name(fact.task)}, for which it did not wait"
            world.broken(rules.WAITS, fact.task, what)
        return
    past = next((moment for moment in waits if item is None or item.reached & moment), 0)
    if not past and len(set(waits)) > 1:  # one was given up, and the fact does not say which
        waits[:] = [0] * len(waits)
    waits.remove(past or waits[0])
    if not waits:
        del world.waits[fact.key]
        if item is not None:
            item.waiters.pop(fact.key, None)


def check_waits(world: JournalWorld, item: MessageRecord) -> None:
    """Check that nobody waits for what is past."""
    for key in item.waiters:
        for moment in world.waits.get(key, ()):
            if item.reached & moment:
                words = ", ".join(describe_moments(moment))
                world.broken(rules.WAITS, item.id, f"'{key[0]}' still waits for {words} of {item}, which is past")


# --- no event ends while a task that it touched could still go on ----------------------------------------------------


def check_settled(world: JournalWorld) -> None:
    """Check that every task touched by this event has reached all it could."""
    for item in world.touched:
        if item.is_over:
            for claim in item.claims.values():
                what = f"is over, and {claim_in_words(claim)}, which was made for it, is not"
                world.broken(rules.GRANTED, item, what)
        elif item.is_task and not item.is_stranger:
            moment = _killed_moment(item) if item.is_killed else _moment(item)
            if moment:
                words = ", ".join(describe_moments(moment))
                world.broken(rules.SETTLED, item.id, f"nothing keeps {item} from {words}, and it does not reach that")
            check_watchers(world, item)


def _killed_moment(item: MessageRecord) -> int:
    """Check that a killed task waits only for the handlers below it."""
    if item.place is not None:
        return 0
    missing = (START_HANDLING | START_PLANNING | START_ACHIEVING | END_HANDLING) & ~item.reached
    return missing or (0 if item.children else END_ACHIEVING)


def _first_moment(item: MessageRecord) -> int:
    """Check that a task that waits for nothing has started."""
    if item.is_queued or item.is_suspended or item.is_orphan or not_startable(item):
        return 0
    start = START_PLANNING if item.is_goal else START_ACHIEVING
    needed = start | (START_ACHIEVING if is_delayed(item) else 0)
    is_free = item.role or item.parent is None or item.parent.reached & needed == needed
    return start if is_free else 0


def _moment(item: MessageRecord) -> int:
    """Check that a moment that nothing holds back has been reached."""
    reached = item.reached
    if not reached & START_HANDLING:
        return _first_moment(item)
    if item.is_goal and not reached & START_ACHIEVING and not (item.is_orphan and item.parent is None):
        is_free = item.role or item.parent is None or item.parent.reached & START_ACHIEVING
        if is_free and not not_met(item, START_ACHIEVING):
            return START_ACHIEVING
    return _end_moment(item) if item.returned and item.place is None else 0


def _end_moment(item: MessageRecord) -> int:
    """The next end moment of a task whose handler is done."""
    if not item.reached & END_HANDLING:
        end, is_open = END_HANDLING, False
    elif not item.reached & END_PLANNING:
        end, is_open = END_PLANNING, bool(item.unplanned)
    else:
        end, is_open = END_ACHIEVING, bool(item.children) or not item.reached & START_ACHIEVING
    return 0 if is_open or not_met(item, end) else end
