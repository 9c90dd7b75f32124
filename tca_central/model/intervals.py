"""The legal order of moments within a task, as a table (TCA 8.5 and TCM: intra-node rules).

Theory of operation. A goal's handling and planning start together, as soon as planning may start, even while its
achievement is still held back: that is planning ahead. A command is a leaf of planning: its planning interval is over
when it is created; its handling and achieving start together. Both end achieving last. A row that is missing from
MUST_FOLLOW is an order that cannot happen: the start moments that are missing are reached by delivery to a handler.

    goal      start handling = start planning ─► start achieving ─────────────► end achieving
                     └─► end handling ─► end planning ─────────────────────────────┘
    command   start handling = start achieving ─► end handling ─► end achieving
"""

from tca_wire.points import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    Moment,
)

DELIVERED, RETURNED, SENT, SUCCESS, FAILURE, REPLIED, KILLED = (64 << i for i in range(7))
"""What happens to a message beside its moments, as further bits: a wiretap may be fired by it."""

STARTS = START_HANDLING | START_PLANNING | START_ACHIEVING
SINGLE_MOMENTS = frozenset(int(moment) for moment in Moment)

MUST_FOLLOW_IN_GOAL = (
    (START_ACHIEVING, START_HANDLING),
    (END_HANDLING, START_HANDLING),
    (END_PLANNING, END_HANDLING),
    (END_ACHIEVING, START_ACHIEVING | END_HANDLING | END_PLANNING),
)
MUST_FOLLOW_IN_COMMAND = (
    (END_HANDLING, START_HANDLING),
    (END_ACHIEVING, END_HANDLING),
)
"""(moment, the moments of the same task that come before it), in an order in which they can be reached in one pass."""

REACHED_AT_BIRTH_BY_COMMAND = START_PLANNING | END_PLANNING

STARTS_OF_GOAL = START_HANDLING | START_PLANNING
STARTS_OF_COMMAND = START_HANDLING | START_ACHIEVING


def delivered_at(is_goal: bool) -> int:
    """The start moment whose constraints hold back a task's delivery to its handler."""
    return START_PLANNING if is_goal else START_ACHIEVING


def unified(is_goal: bool, moment: int) -> int:
    """The one moment that stands for those reached together, so that a constraint on either holds both."""
    return delivered_at(is_goal) if moment == START_HANDLING else moment


def successors_within(is_goal: bool, moment: int) -> tuple[int, ...]:
    """The moments of the same task that come directly after *moment*."""
    return _NEXT[is_goal].get(moment, ())


def predecessors_within(is_goal: bool, moment: int) -> tuple[int, ...]:
    """The moments of the same task that come directly before *moment*."""
    return _PREVIOUS[is_goal].get(moment, ())


def comes_after(is_goal: bool, moment: int) -> frozenset[int]:
    """*moment* and all moments of the same task that cannot be reached before it."""
    found, frontier = {moment}, [moment]
    for place in frontier:  # grows while it is walked
        new = [following for following in successors_within(is_goal, place) if following not in found]
        found.update(new)
        frontier += new
    return frozenset(found)


_NEXT: dict[bool, dict[int, tuple[int, ...]]] = {
    True: {
        START_PLANNING: (START_ACHIEVING, END_HANDLING),
        START_ACHIEVING: (END_ACHIEVING,),
        END_HANDLING: (END_PLANNING,),
        END_PLANNING: (END_ACHIEVING,),
    },
    False: {START_ACHIEVING: (END_HANDLING,), END_HANDLING: (END_ACHIEVING,)},
}
_PREVIOUS = {
    is_goal: {
        after: tuple(before for before, nexts in order.items() if after in nexts)
        for after in {moment for nexts in order.values() for moment in nexts}
    }
    for is_goal, order in _NEXT.items()
}
