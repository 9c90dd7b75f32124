"""Response-time analysis of processors with fixed priorities, and policies of allocation.

Pure: the results depend only on names, periods and execution times.

A processor is schedulable if each tick, from the time when it was due, ends within one period of
the processor. The processor's period is the least period of its activities. In the worst case all
activities are due at once. Then the processor must do its own activities. The processor must also
wait for all activities of a higher priority that become due in the meantime. The bound is the least
solution R, up to the processor's period, of

    R = B + sum of its own execution times
          + sum over activities of higher priority: ceil(R / period) * execution time.

If processors preempt each other at once, B is 0 and the bound is exact. If they switch only between
activities, B is the longest execution time of an activity of lower priority: it may just have
begun. Then the bound is safe, but no tick may ever take so long. The bound counts execution times
only, not the time for switching or for other programs.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

_ROUNDING = 1e-9  # the relative error that rounding may cause


class Demand(NamedTuple):
    """The name, period and longest execution time of an activity."""

    name: str
    period: float
    cost: float
    """Its longest execution time."""


def period(processor: Sequence[Demand]) -> float:
    """Return the period of a processor: the least of its activities."""
    return min(activity.period for activity in processor)


def utilisation(activities: Sequence[Demand]) -> float:
    """Return the share of time that activities need."""
    return sum(activity.cost / activity.period for activity in activities)


def response_bounds(
    processors: Sequence[Sequence[Demand]], *, preemptive: bool = False
) -> list[float | None]:
    """Return the response-time bound of each processor; None if it may exceed the processor's
    period.

    A processor is given by the demands of its activities. The highest priority comes first.
    """
    bounds = []
    for number, processor in enumerate(processors):
        higher = [activity for each in processors[:number] for activity in each]
        lower = [activity for each in processors[number + 1 :] for activity in each]
        bounds.append(response_bound(processor, higher, [] if preemptive else lower))
    return bounds


def response_bound(
    processor: Sequence[Demand], higher: Sequence[Demand], lower: Sequence[Demand]
) -> float | None:
    """Return the bound for one processor; None if it may exceed the processor's period.

    *higher* are the activities of higher priority. *lower* are the activities of lower priority
    that can't be preempted.
    """
    limit = period(processor) * (1 + _ROUNDING)
    blocking = max((activity.cost for activity in lower), default=0.0)
    own = blocking + sum(activity.cost for activity in processor)
    bound = own + sum(activity.cost for activity in higher)
    while bound <= limit:
        next_bound = own + sum(
            math.ceil(bound / activity.period - _ROUNDING) * activity.cost for activity in higher
        )
        if next_bound <= bound * (1 + _ROUNDING):
            return bound
        bound = next_bound
    return None


# --- bounds of utilisation, for preemptive processors whose activities have one period each -------


def liu_layland(number: int) -> float:
    """Return the utilisation up to which *number* processors are schedulable, if their priorities
    are rate-monotonic.
    """
    return number * (2 ** (1 / number) - 1) if number else 1.0


def is_hyperbolic(utilisations: Iterable[float]) -> bool:
    """Return whether processors with these utilisations are schedulable by the hyperbolic bound.

    This bound accepts more than the bound of Liu and Layland.
    """
    return math.prod(1 + each for each in utilisations) <= 2


# --- policies: which processor ticks which activities ---------------------------------------------

Allocation = dict[str, list[str]]
"""The names of activities in order of subscription, by processor."""
Policy = Callable[[Sequence[Demand]], Allocation]


def one_for_all(activities: Sequence[Demand]) -> Allocation:
    """Allocate all activities to one processor, in the given order.

    Args:
        activities: the activities with their demands, in order of subscription.

    Returns:
        The names of the activities, by processor.
    """
    return {"all": [activity.name for activity in activities]}


def one_each(activities: Sequence[Demand]) -> Allocation:
    """Allocate each activity to a processor of its own, with its name.

    Args:
        activities: the activities with their demands, in order of subscription.

    Returns:
        The names of the activities, by processor.
    """
    return {activity.name: [activity.name] for activity in activities}


def automatic(activities: Sequence[Demand]) -> Allocation:
    """Allocate the activities to the fewest processors that are schedulable.

    Activities come in rate-monotonic order: the shortest period first. Each activity joins the
    processor of the previous activity, if that processor stays schedulable. An activity that is not
    schedulable alone gets a processor of its own.

    No other division of this order into processors needs fewer processors. To see why, compare two
    processors with the same last activity. Both bounds count the same activities. The processor
    that starts later in the order has the same period or a longer one.

    Args:
        activities: the activities with their demands, in order of subscription.

    Returns:
        The names of the activities, by processor.
    """
    # The sort is stable: equal periods stay in the order of subscription.
    order = sorted(activities, key=lambda activity: activity.period)
    groups: list[list[Demand]] = []
    start = 0  # the place of the first activity of the last group
    for place, activity in enumerate(order):
        joined = order[start : place + 1]
        if groups and response_bound(joined, order[:start], order[place + 1 :]) is not None:
            groups[-1].append(activity)
        else:
            groups.append([activity])
            start = place
    return {
        f"processor {number}": [activity.name for activity in group]
        for number, group in enumerate(groups, 1)
    }
