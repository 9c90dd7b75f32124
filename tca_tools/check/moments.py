"""The order of moments: within a task, by constraints, after the parent's starts and the children's ends."""

from collections.abc import Iterable

from tca_tools.check.asking import check_waits
from tca_tools.check.births import not_met
from tca_tools.check.failing import handler_ended
from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import (
    COMMAND,
    CONSTRAINT,
    FAMILY,
    ONCE,
    ONE_HANDLER,
    ORDER,
    RECOVERED,
    RETURNED,
    SETTLED,
    SUSPENDED,
)
from tca_tools.check.taps import check_fired, forget_task
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    describe_moments,
)
from tca_wire.rules import AT_BIRTH, NO_LATER, PARENT_FIRST
from tca_wire.vocabulary import Role

_REACHED = [f"reached {', '.join(describe_moments(moments))}" for moments in range(ALL_MOMENTS + 1)]


def reached(world: JournalWorld, fact: facts.Reached) -> None:
    """A task reaches moments."""
    moments = fact.moments
    item = world.task(fact.task, _REACHED[moments & ALL_MOMENTS])
    if item is None:
        return
    if twice := item.reached & moments:
        world.broken(ONCE, item.id, f"{item} reached {_words(twice)} a second time")
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
                hold.due = world.now + hold.constraint.delay
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
    for moment, needed in NO_LATER[item.is_goal].items():
        if moments & moment and (missing := (needed | AT_BIRTH[item.is_goal]) & ~item.reached):
            rule = COMMAND if moment in (START_HANDLING, START_ACHIEVING, START_PLANNING) else ORDER
            world.broken(rule, item.id, f"{item} reached {_words(moment)} before {_words(missing)}")


def _check_starts(world: JournalWorld, item: MessageRecord, moments: int, before: int) -> None:
    if missing := not_met(item, moments):
        world.broken(CONSTRAINT, item.id, f"{item} reached {_words(moments)} before {missing}")
    parent = item.parent
    starts = PARENT_FIRST & ~AT_BIRTH[item.is_goal]
    if parent is not None and not item.role and (early := moments & starts & ~parent.reached):
        world.broken(FAMILY, item.id, f"{item} reached {_words(early)} before {parent}, under which it is, did")
    if moments & START_HANDLING:
        if item.is_suspended and not item.is_orphan:
            world.broken(SUSPENDED, item.id, f"{item} was begun while it was suspended")
        if item.place is None and not item.message_class.is_monitor:
            world.broken(ONE_HANDLER, item.id, f"{item} was begun, and no handler has it")
        item.begun_in = world.event
    if moments & END_HANDLING and before & START_HANDLING:
        _check_handled(world, item)


def _check_handled(world: JournalWorld, item: MessageRecord) -> None:
    """Check that the handler has returned and its failure has been dealt with."""
    if item.deciding:
        what = f"{item} was handled while {world.name(item.deciding)} had not dealt with its failure"
        world.broken(RECOVERED, item.id, what)
    elif item.again:
        world.broken(SETTLED, item.id, f"{item} was handled, and is to be handled again")
    elif not item.returned and not (item.message_class.is_monitor and item.begun_in == world.event):
        world.broken(RETURNED, item.id, f"{item} was handled, and its handler has not returned")


def _check_ends(world: JournalWorld, item: MessageRecord, moments: int) -> None:
    if item.place is not None:
        world.broken(ONE_HANDLER, item.id, f"{item} reached {_words(moments)} while a handler had it")
    if moments & END_ACHIEVING and item.children:
        world.broken(FAMILY, item.id, f"{item} ended before {_listed(item.children.values())}, which is under it")
    elif moments & END_PLANNING and item.unplanned and item.is_goal:
        late = [child for child in item.children.values() if child.is_goal and not child.reached & END_PLANNING]
        world.broken(FAMILY, item.id, f"{item} was planned before {_listed(late)}, which is under it")


def _listed(items: Iterable[MessageRecord]) -> str:
    names = [str(item) for item in items]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _end(world: JournalWorld, item: MessageRecord) -> None:
    """A task has ended."""
    if item.parent is not None:
        item.parent.children.pop(item.id, None)
        world.touched[item.parent] = None
    if item.role is Role.EXCEPTION and not item.is_void:
        handler_ended(world, item)
    forget_task(world, item)
    world.finish(item)
