"""The causes that keep a task from its moments: order, constraints, parent, children, and handler.

A moment that is reached in spite of such a cause is too early. A moment that is not reached
although no such cause exists is missed.
"""

from collections.abc import Iterator

from tca_tools.check import rules
from tca_tools.check.records import Hold, MessageRecord
from tca_tools.check.rules import Rule
from tca_tools.check.world import JournalWorld
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    MOMENTS,
    ROOT,
    START_ACHIEVING,
    START_HANDLING,
    STARTS,
    describe_moments,
)
from tca_wire.rules import PARENT_FIRST, RULES, TaskRules
from tca_wire.text.measures import duration, run_time

_ENDS = (END_HANDLING, END_PLANNING, END_ACHIEVING)


def _needed(task_rules: TaskRules, moments: int) -> int:
    needed = 0
    for moment, before in task_rules.up_to.items():
        if moments & moment:
            needed |= before | task_rules.at_birth
    return needed


_NEEDED = [[_needed(one, moments) for moments in range(ALL_MOMENTS + 1)] for one in RULES]
"""For commands and for goals, by set of moments: the moments that a task must reach before this set
or with it.
"""
_PARENT_FIRST = [PARENT_FIRST & ~one.at_birth for one in RULES]
"""For commands and for goals: the moments that the parent must reach before the task does."""


def in_words(moments: int) -> str:
    """Return moments in words."""
    return ", ".join(describe_moments(moments))


def next_moments(item: MessageRecord) -> Iterator[int]:
    """Yield sets of moments. A task must reach each set now, unless it is too early for the set."""
    reached = item.reached
    if item.is_killed:
        if item.place is None:
            yield (STARTS | END_HANDLING) & ~reached or ALL_MOMENTS & ~reached
    elif not reached & START_HANDLING:
        if not (item.is_queued or item.is_suspended or item.is_orphan):
            yield first_moments(item)
    else:
        has_unknown_parent = item.is_orphan and item.parent is None
        if item.is_goal and not reached & START_ACHIEVING and not has_unknown_parent:
            yield START_ACHIEVING
        if item.has_returned and item.place is None:
            yield from [end for end in _ENDS if not reached & end][:1]


def first_moments(item: MessageRecord) -> int:
    """Return the moments that a task reaches when it is delivered to a handler."""
    first = RULES[item.is_goal].delivery
    for hold in item.holds:
        if hold.before is item and hold.moment & first:
            return first | START_ACHIEVING
    return first


def why_too_early(
    world: JournalWorld, item: MessageRecord, moments: int, before: int
) -> list[tuple[Rule, str]]:
    """Return the reasons why moments that come together are too early, with their rules.

    Args:
        world: The world at the event.
        item: The task.
        moments: The moments, as bits.
        before: The moments that the task has reached before.
    """
    found: list[tuple[Rule, str]] = []
    if not item.is_incomplete:
        if _NEEDED[item.is_goal][moments] & ~(before | moments):
            found += _out_of_order(item.is_goal, moments, before | moments)
        if not item.is_killed:
            found += _held_back(item, moments)
            if moments & END_HANDLING and before & START_HANDLING:
                found += _not_handled(world, item)
    if item.place is not None and moments & (END_HANDLING | END_PLANNING | END_ACHIEVING):
        found.append((rules.ONE_HANDLER, "while a handler had it"))
    if item.children and (child := _child_to_come_first(item, moments)) is not None:
        found.append((rules.FAMILY, f"before {child}, which is under it"))
    return found


def _out_of_order(is_goal: bool, moments: int, reached: int) -> Iterator[tuple[Rule, str]]:
    for moment in MOMENTS:
        if moments & moment and (missing := _NEEDED[is_goal][moment] & ~reached):
            yield rules.COMMAND if moment & STARTS else rules.ORDER, f"before {in_words(missing)}"


def _held_back(item: MessageRecord, moments: int) -> Iterator[tuple[Rule, str]]:
    """Yield the constraints, the parent and the suspension that hold moments back."""
    if item.holds and (missing := not_met(item, moments)):
        yield rules.CONSTRAINT, f"before {missing}"
    parent = item.parent
    needed = moments & _PARENT_FIRST[item.is_goal]
    if parent is not None and needed & ~parent.reached and not item.role:
        yield rules.FAMILY, f"before the start of {parent}, under which it is"
    if moments & START_HANDLING and item.is_suspended and not item.is_orphan:
        yield rules.SUSPENDED, "while it was suspended"


def _not_handled(world: JournalWorld, item: MessageRecord) -> Iterator[tuple[Rule, str]]:
    """Yield the reasons why a task's handling has not ended."""
    if item.deciding:
        yield rules.RECOVERED, f"while {world.name(item.deciding)} had not dealt with its failure"
    elif item.is_retry_due:
        yield rules.SETTLED, "though a retry is due"
    elif not item.has_returned and not (
        item.message_class.is_monitor and item.begun_in == world.event
    ):
        yield rules.RETURNED, "before its handler returned"


def _child_to_come_first(item: MessageRecord, moments: int) -> MessageRecord | None:
    """Return a child that must reach the moment first; None if no child must."""
    if moments & END_ACHIEVING:
        return next(iter(item.children.values()))
    if not (moments & END_PLANNING and item.is_goal and item.unplanned):
        return None
    goals = (child for child in item.children.values() if child.is_goal)
    return next((goal for goal in goals if not goal.reached & END_PLANNING), None)


def not_met(item: MessageRecord, moments: int) -> str:
    """Return the unmet constraints on moments that come together, in words."""
    unmet = [
        _hold_in_words(hold)
        for hold in item.holds
        if hold.moment & moments
        and not hold.is_met
        and not (hold.before is item and hold.needs & moments)
    ]
    return ", ".join(unmet)


def _hold_in_words(hold: Hold) -> str:
    constraint = hold.constraint
    if constraint.before.task == ROOT:
        return run_time(constraint.delay)
    delay = f"{duration(constraint.delay)} after " if constraint.delay else ""
    return f"{delay}{in_words(constraint.before.moment)} of {hold.before or constraint.before.task}"
