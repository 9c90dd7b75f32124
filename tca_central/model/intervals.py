"""The moments of a task as nodes in the graph of constraints.

The first delivery of a task reaches two starts together: the start of handling, and the start of
planning (goal) or of achieving (other tasks). The second of them stands for both.
"""

from tca_central.errors import RequestError
from tca_wire.points import MOMENTS, START_ACHIEVING, START_HANDLING, START_PLANNING, Point
from tca_wire.rules import RULES
from tca_wire.vocabulary import Refusal

SINGLE_MOMENTS = tuple(int(moment) for moment in MOMENTS)


def checked_moment(point: Point) -> int:
    """Return the moment of a point. Raise RequestError if it is not exactly one moment."""
    moment = int(point.moment)
    if moment not in SINGLE_MOMENTS:
        raise RequestError(Refusal.PROTOCOL, f"{moment} is not a moment: give one bit of 1 to 32")
    return moment


def delivered_at(is_goal: bool) -> int:
    """Return the start moment whose constraints hold back a task's delivery."""
    return START_PLANNING if is_goal else START_ACHIEVING


def unified(is_goal: bool, moment: int) -> int:
    """Return the moment that stands for *moment* in the graph.

    Only the start of handling has another moment to stand for it (``delivered_at``). A constraint
    on either of these two starts holds both.
    """
    return delivered_at(is_goal) if moment == START_HANDLING else moment


PREVIOUS = {
    (is_goal, moment): tuple(unified(is_goal, one) for one in SINGLE_MOMENTS if one & before)
    for is_goal in (True, False)
    for moment, before in RULES[is_goal].order
}
"""By (is goal, moment): the moments of the same task that come directly before that moment.

A moment without earlier moments has no row.
"""

NEXT = {
    (is_goal, moment): tuple(
        after
        for (of_goal, after), befores in PREVIOUS.items()
        if of_goal is is_goal and moment in befores
    )
    for is_goal in (True, False)
    for moment in SINGLE_MOMENTS
}
"""By (is goal, moment): the moments of the same task that come directly after that moment."""
