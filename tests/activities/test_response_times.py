"""The analysis of response times agrees with a simulation."""

import math
from collections.abc import Sequence
from itertools import combinations

import pytest
from activities.scheduling import in_virtual_time, task_sets
from hypothesis import given
from hypothesis import strategies as st

from tca_behaviours.activities.analysis import (
    Demand,
    automatic,
    is_hyperbolic,
    liu_layland,
    one_each,
    one_for_all,
    period,
    response_bounds,
    utilisation,
)
from tca_module.period import Period

HYPERPERIOD = 120_000

Processors = Sequence[Sequence[Demand]]


@st.composite
def processors(draw: st.DrawFn) -> Processors:
    """Activities divided among processors of random priorities."""
    activities = draw(task_sets())
    places = draw(st.lists(st.integers(0, 3), min_size=len(activities), max_size=len(activities)))
    return [
        [one for one, place in zip(activities, places, strict=True) if place == wanted]
        for wanted in draw(st.permutations(sorted(set(places))))
    ]


def preemptive_responses(processors: Processors) -> list[float]:
    """Return each processor's longest response time under preemptive scheduling by priority."""
    releases = sorted(
        (float(turn * one.period), number, one.cost)
        for number, each in enumerate(processors)
        for one in each
        for turn in range(round(HYPERPERIOD / one.period))
    )
    waiting: list[list[tuple[float, float]]] = [
        [] for _ in processors
    ]  # release time, remaining work
    longest = [0.0 for _ in processors]
    now = 0.0
    while releases or any(waiting):
        while releases and releases[0][0] <= now:
            released, number, cost = releases.pop(0)
            waiting[number].append((released, cost))
        next_release = releases[0][0] if releases else math.inf
        number = next((number for number, jobs in enumerate(waiting) if jobs), -1)
        if number < 0:
            now = next_release
            continue
        released, left = waiting[number][0]
        if now + left <= next_release:
            now += left
            waiting[number].pop(0)
            longest[number] = max(longest[number], now - released)
        else:
            waiting[number][0] = (released, left - (next_release - now))
            now = next_release
    return longest


@given(processors())
def test_response_bounds_are_exact_for_preemptive_processors(processors: Processors) -> None:
    bounds = response_bounds(processors, preemptive=True)
    for each, bound, longest in zip(
        processors, bounds, preemptive_responses(processors), strict=True
    ):
        if bound is None:
            assert longest > period(each)
        else:
            assert longest == bound


@given(processors(), st.lists(st.integers(0, 24_000), min_size=6, max_size=6))
def test_response_bounds_are_safe_without_preemption(
    processors: Processors, offsets: list[int]
) -> None:
    """The bounds are safe for any offsets of the activities."""
    baton = in_virtual_time(processors)
    for activity, offset in zip(baton.schedule.activities.values(), offsets, strict=False):
        activity.release = Period(float(offset), activity.period)
    baton.schedule.update_order()
    baton.run(HYPERPERIOD)
    bounds = response_bounds(processors)
    for one, bound in zip(baton.schedule.processors, bounds, strict=True):
        assert bound is None or (one.overruns == 0 and one.times.response <= bound <= one.period)
    if None not in bounds:
        assert [
            one.release.missed for one in baton.schedule.activities.values() if one.release.missed
        ] == []


@given(task_sets())
def test_automatic_policy_uses_the_fewest_processors(activities: list[Demand]) -> None:
    order = sorted(activities, key=lambda one: one.period)
    named = {one.name: one for one in activities}
    found = [[named[name] for name in names] for names in automatic(activities).values()]
    assert [one for each in found for one in each] == order
    if None not in response_bounds(found):
        fewer = (
            [order[begin:end] for begin, end in zip((0, *cuts), (*cuts, len(order)), strict=True)]
            for number in range(len(found) - 1)
            for cuts in combinations(range(1, len(order)), number)
        )
        assert all(None in response_bounds(each) for each in fewer)


@given(task_sets())
def test_classical_utilisation_bounds_are_safe(activities: list[Demand]) -> None:
    each = [[one] for one in sorted(activities, key=lambda one: one.period)]
    used = [utilisation(one) for one in each]
    if sum(used) <= liu_layland(len(used)):
        assert is_hyperbolic(used)
    if is_hyperbolic(used):
        assert None not in response_bounds(each, preemptive=True)


def test_policies_divide_activities_among_processors() -> None:
    activities = [
        Demand("slow", 0.1, 0.03),
        Demand("fast", 0.01, 0.002),
        Demand("fair", 0.02, 0.001),
    ]
    assert one_for_all(activities) == {"all": ["slow", "fast", "fair"]}
    assert one_each(activities) == {"slow": ["slow"], "fast": ["fast"], "fair": ["fair"]}
    # a tick of 30 ms is too long for every other activity
    assert automatic(activities) == {
        "processor 1": ["fast"],
        "processor 2": ["fair"],
        "processor 3": ["slow"],
    }
    assert response_bounds([[activities[1]], [activities[2]], [activities[0]]]) == [
        None,
        None,
        pytest.approx(0.04),
    ]
    short = [Demand("slow", 0.1, 0.009), *activities[1:]]
    assert automatic(short) == {"processor 1": ["fast"], "processor 2": ["fair", "slow"]}
