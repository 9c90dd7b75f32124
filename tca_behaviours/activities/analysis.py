"""Response-time analysis of processors with fixed priorities, and the policies that allocate
activities to them. Pure:
from names, periods and execution times.

A processor is schedulable if each tick ends within one period of the processor, the least of its
activities, after it was due. In the worst case all activities are due at once. Then a processor is
done after its own execution times and those of all that comes before it meanwhile. So the bound is
the least R that solves

    R = B + sum of its own execution times + sum over activities of higher priority: ceil(R /
    period) * execution time

up to its period. Where processors preempt each other at once B is 0, and the bound is exact. Where
they are switched between activities, B is the longest execution time of a lower priority, which may
just have begun; the bound is safe then, but need not be reached. Execution times alone count: none
for switching, none for other programs.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

_EXACT = 1e-9  # of a period: so much comes of rounding


class Demand(NamedTuple):
    """What an activity needs."""

    name: str
    period: float
    cost: float
    """Its longest execution time."""


def period(processor: Sequence[Demand]) -> float:
    """That of a processor: the least of its activities."""
    return min(one.period for one in processor)


def utilisation(activities: Sequence[Demand]) -> float:
    """The share of time that they need."""
    return sum(one.cost / one.period for one in activities)


def response_bounds(
    processors: Sequence[Sequence[Demand]], *, preemptive: bool = False
) -> list[float | None]:
    """The bound for each processor, given by the demands of its activities, the highest priority
    first. None: it may exceed its period.
    """
    bounds = []
    for number, processor in enumerate(processors):
        higher = [one for each in processors[:number] for one in each]
        lower = [] if preemptive else [one for each in processors[number + 1 :] for one in each]
        bounds.append(response_bound(processor, higher, lower))
    return bounds


def response_bound(
    processor: Sequence[Demand], higher: Sequence[Demand], lower: Sequence[Demand]
) -> float | None:
    """The bound for one, among activities of higher priority, and those of lower priority that
    can't be preempted.
    """
    limit = period(processor) * (1 + _EXACT)
    own = max((one.cost for one in lower), default=0.0) + sum(one.cost for one in processor)
    bound = own + sum(one.cost for one in higher)
    while bound <= limit:
        found = own + sum(math.ceil(bound / one.period - _EXACT) * one.cost for one in higher)
        if found <= bound * (1 + _EXACT):
            return bound
        bound = found
    return None


# --- bounds of utilisation, for preemptive processors whose activities have one period each -------


def liu_layland(number: int) -> float:
    """So many processors with rate-monotonic priorities are schedulable if they use no more than
    this.
    """
    return number * (2 ** (1 / number) - 1) if number else 1.0


def is_hyperbolic(utilisations: Iterable[float]) -> bool:
    """Whether processors that use so much each are schedulable by the hyperbolic bound, which
    accepts more.
    """
    return math.prod(1 + each for each in utilisations) <= 2


# --- policies: which processor ticks which activities ---------------------------------------------

Allocation = dict[str, list[str]]
"""The names of activities in order of subscription, by processors."""
Policy = Callable[[Sequence[Demand]], Allocation]


def one_for_all(activities: Sequence[Demand]) -> Allocation:
    """One processor, in the order given."""
    return {"all": [one.name for one in activities]}


def one_each(activities: Sequence[Demand]) -> Allocation:
    """A processor for each activity, with its name."""
    return {one.name: [one.name] for one in activities}


def automatic(activities: Sequence[Demand]) -> Allocation:
    """The fewest processors that are schedulable.

    Activities are taken in rate-monotonic order: the shortest period first. Each joins the
    processor of the one before it, unless that would not be schedulable any more. No other way to
    cut this order into processors needs fewer: a processor that begins later has a longer period,
    and the same activities before it. An activity that is not schedulable alone has a processor of
    its own.
    """
    order = sorted(
        activities, key=lambda one: one.period
    )  # stable: the order of subscription stays
    groups: list[list[Demand]] = []
    begin = 0
    for place, one in enumerate(order):
        joined = order[begin : place + 1]
        if groups and response_bound(joined, order[:begin], order[place + 1 :]) is not None:
            groups[-1].append(one)
        else:
            groups.append([one])
            begin = place
    return {
        f"processor {number}": [one.name for one in group] for number, group in enumerate(groups, 1)
    }
