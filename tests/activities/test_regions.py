"""Random regions make the same transitions as python-statemachine."""

from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tca_behaviours.activities.components import Region, RegionState
from tca_behaviours.activities.components.states import RegionTransition
from tca_behaviours.statecharts.library import LibraryInterpreter

EVENTS = ("a", "b")
GUARDS = ("", "p", "q")


class Arrow(NamedTuple):
    source: int
    target: int
    event: str
    guard: str


class RandomChart(NamedTuple):
    """A random statechart: parents of states (-1: none; each before its children), and arrows."""

    parents: list[int]
    arrows: list[Arrow]


@st.composite
def random_charts(draw: st.DrawFn) -> RandomChart:
    count = draw(st.integers(2, 6))
    parents = [-1] + [draw(st.integers(-1, number - 1)) for number in range(1, count)]
    states = st.integers(0, count - 1)
    arrow = st.builds(Arrow, states, states, st.sampled_from(EVENTS), st.sampled_from(GUARDS))
    return RandomChart(parents, draw(st.lists(arrow, min_size=2, max_size=10)))


def guard_of(name: str, flags: set[str]) -> Callable[[], bool] | None:
    return (lambda: name in flags) if name else None


def write_region(chart: RandomChart, flags: set[str], log: list[str]) -> Region:
    region = Region("x", "y", 1.0, None)
    states: list[RegionState] = []
    for number, parent in enumerate(chart.parents):
        around: Region | RegionState = region if parent < 0 else states[parent]
        state = around.state(
            f"s{number}", entry=_logged(log, f"+s{number}"), exit=_logged(log, f"-s{number}")
        )
        states.append(state)
    for arrow in chart.arrows:
        states[arrow.source].to(
            states[arrow.target], on=arrow.event, when=guard_of(arrow.guard, flags)
        )
    return region


def _logged(log: list[str], text: str) -> Callable[[], None]:
    return lambda: log.append(text)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@settings(max_examples=40)
@given(
    random_charts(),
    st.lists(st.tuples(st.sampled_from(EVENTS), st.sets(st.sampled_from(GUARDS[1:]))), max_size=8),
)
def test_region_agrees_with_the_statechart_library(
    chart: RandomChart, events: list[tuple[str, set[str]]]
) -> None:
    flags: set[str] = set()
    ours: list[str] = []
    theirs: list[str] = []
    region = write_region(chart, flags, ours)
    region.reset()
    region.enter_first()
    oracle = LibraryInterpreter[RegionState, RegionTransition](
        list(write_region(chart, flags, theirs).root.all())[1:]
    )
    oracle.begin()
    for event, true in [("", set[str]()), *events]:
        flags.clear()
        flags.update(true)
        taken = region.take(event)
        assert len(oracle.take(event)) == len(taken)
        assert region.path == tuple(state.label for state in oracle.active)
        assert ours == theirs
