"""The moments of a task as places in the graph of constraints: some are reached together, and one stands for both."""

from tca_central.errors import RequestError
from tca_wire.points import MOMENTS, START_ACHIEVING, START_HANDLING, START_PLANNING, Point
from tca_wire.rules import ORDER
from tca_wire.vocabulary import Refusal

STARTS = START_HANDLING | START_PLANNING | START_ACHIEVING
SINGLE_MOMENTS = frozenset(int(moment) for moment in MOMENTS)


def checked_moment(point: Point) -> int:
    """The moment of a point. Raises RequestError if it is not one moment."""
    moment = int(point.moment)
    if moment not in SINGLE_MOMENTS:
        raise RequestError(Refusal.PROTOCOL, f"{moment} is not a moment: give one bit of 1 to 32")
    return moment


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


_PREVIOUS: dict[bool, dict[int, tuple[int, ...]]] = {
    is_goal: {
        moment: tuple(unified(is_goal, one) for one in sorted(SINGLE_MOMENTS) if one & before)
        for moment, before in order
    }
    for is_goal, order in ORDER.items()
}
_NEXT: dict[bool, dict[int, tuple[int, ...]]] = {
    is_goal: {
        before: tuple(after for after, befores in order.items() if before in befores)
        for before in {moment for befores in order.values() for moment in befores}
    }
    for is_goal, order in _PREVIOUS.items()
}
