"""Policies: which processor ticks which activities. Pure: from names, periods and execution times to names."""

from collections.abc import Callable, Sequence

from tca_behaviours.activities.analysis.response_times import Demand, response_bound

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

    Activities are taken in rate-monotonic order: the shortest period first. Each joins the processor of the one before
    it, unless that would not be schedulable any more. No other way to cut this order into processors needs fewer: a
    processor that begins later has a longer period, and the same activities before it. An activity that is not
    schedulable alone has a processor of its own.
    """
    order = sorted(activities, key=lambda one: one.period)  # stable: the order of subscription stays
    groups: list[list[Demand]] = []
    begin = 0
    for place, one in enumerate(order):
        joined = order[begin : place + 1]
        if groups and response_bound(joined, order[:begin], order[place + 1 :]) is not None:
            groups[-1].append(one)
        else:
            groups.append([one])
            begin = place
    return {f"processor {number}": [one.name for one in group] for number, group in enumerate(groups, 1)}
