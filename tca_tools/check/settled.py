"""No event ends while a task that it touched could still go on."""

from tca_tools.check.births import is_delayed, not_met, not_startable
from tca_tools.check.presence import check_claims
from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import SETTLED
from tca_tools.check.world import JournalWorld
from tca_wire.points import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    describe_moments,
)


def check_settled(world: JournalWorld) -> None:
    """Check that every task touched by this event has reached all it could."""
    for item in world.touched:
        if item.is_over:
            if item.claims:
                check_claims(world, item)
        elif item.is_task and not item.is_stranger:
            moment = _killed_moment(item) if item.is_killed else _moment(item)
            if moment:
                words = ", ".join(describe_moments(moment))
                world.broken(SETTLED, item.id, f"nothing keeps {item} from {words}, and it does not reach that")


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
