"""Random regions make the transitions that python-statemachine makes."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from statemachine import State, StateChart
from statemachine.io import create_machine_class_from_definition

from tca_behaviours.activities.components import Region, RegionState

EVENTS = ("a", "b")
GUARDS = ("", "p", "q")


class Arrow(NamedTuple):
    source: int
    target: int
    event: str
    guard: str


class Drawn(NamedTuple):
    """The parents of states, -1 at the top; a parent comes before its children."""

    parents: list[int]
    arrows: list[Arrow]


@st.composite
def drawn(draw: st.DrawFn) -> Drawn:
    count = draw(st.integers(2, 6))
    parents = [-1] + [draw(st.integers(-1, number - 1)) for number in range(1, count)]
    states = st.integers(0, count - 1)
    arrow = st.builds(Arrow, states, states, st.sampled_from(EVENTS), st.sampled_from(GUARDS))
    return Drawn(parents, draw(st.lists(arrow, min_size=2, max_size=10)))


def guard_of(name: str, flags: set[str]) -> Callable[[], bool] | None:
    return (lambda: name in flags) if name else None


def built(chart: Drawn, flags: set[str], log: list[str]) -> Region:
    region = Region("x", "y", 1.0, None)
    states: list[RegionState] = []
    for number, parent in enumerate(chart.parents):
        around: Region | RegionState = region if parent < 0 else states[parent]
        state = around.state(f"s{number}", entry=_logged(log, f"+s{number}"), exit=_logged(log, f"-s{number}"))
        states.append(state)
    for arrow in chart.arrows:
        states[arrow.source].to(states[arrow.target], on=arrow.event, when=guard_of(arrow.guard, flags))
    region.reset()
    region.enter_first()
    return region


def _logged(log: list[str], text: str) -> Callable[[], None]:
    return lambda: log.append(text)


class Logging:
    def __init__(self, log: list[str]) -> None:
        self.on_enter_state: Callable[[State], None] = lambda state: log.append(f"+{state.id}")
        self.on_exit_state: Callable[[State], None] = lambda state: log.append(f"-{state.id}")


def of_the_library(chart: Drawn, flags: set[str], log: list[str]) -> "StateChart[Any]":
    def defined(number: int, is_first: bool) -> Any:
        inside = [inner for inner, parent in enumerate(chart.parents) if parent == number]
        on: dict[str, list[dict[str, Any]]] = {}
        for arrow in chart.arrows:
            if arrow.source == number:
                to: dict[str, Any] = {"target": f"s{arrow.target}"}
                if guard := guard_of(arrow.guard, flags):
                    to["cond"] = guard
                on.setdefault(arrow.event, []).append(to)
        states = {f"s{inner}": defined(inner, inner == inside[0]) for inner in inside}
        return {"initial": is_first, "on": on} | ({"states": states} if states else {})

    tops = [number for number, parent in enumerate(chart.parents) if parent < 0]
    made = create_machine_class_from_definition(
        "Oracle",
        {f"s{number}": defined(number, number == 0) for number in tops},
        catch_errors_as_events=False,
        validate_trap_states=False,
        validate_disconnected_states=False,
        validate_final_reachability=False,
    )
    for order, state in enumerate(_in_order(made.states), 1):
        state.document_order = order
    return made(listeners=[Logging(log)])


def _in_order(states: Any) -> Iterator[State]:
    for state in states:
        yield state
        yield from _in_order(state.states)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@settings(max_examples=40)
@given(drawn(), st.lists(st.tuples(st.sampled_from(EVENTS), st.sets(st.sampled_from(GUARDS[1:]))), max_size=8))
def test_a_region_agrees_with_the_statechart_library(chart: Drawn, events: list[tuple[str, set[str]]]) -> None:
    flags: set[str] = set()
    ours: list[str] = []
    theirs: list[str] = []
    region, oracle = built(chart, flags, ours), of_the_library(chart, flags, theirs)
    assert set(region.path) == set(oracle.configuration_values)
    for event, true in events:
        flags.clear()
        flags.update(true)
        region.events.append(event)
        region.tick()
        oracle.send(event)
        assert set(region.path) == set(oracle.configuration_values)
        assert ours == theirs
