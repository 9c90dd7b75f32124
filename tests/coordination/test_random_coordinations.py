"""Random machines: python-statemachine handles events as the flat automaton predicts.

The automaton is a deterministic probabilistic automaton (definition 1 of the paper).
"""

from itertools import combinations
from math import fsum
from typing import Any

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from sampling import lives

from tca_behaviours.coordination import (
    Activity,
    AuthoredState,
    Coordination,
    Do,
    FlatAutomaton,
    LikelyArrow,
    Prior,
    Situation,
    TakenArrow,
    UnsoundMachine,
)
from tca_module import Command
from tca_wire.charts import StateKind

MOVE = Command("move")
MOST_ARE_REFUSED = settings(
    max_examples=lives(2, soak=100), suppress_health_check=[HealthCheck.filter_too_much]
)
LABELS = [f"s{number}" for number in range(9)]
EVENTS = ["done", "failed", "go", "go on"]
GUARDS = ["g0", "g1"]
"""The guards. Each guard is a fact with its name."""


def write_states(
    machine: Coordination, data: st.DataObject, labels: list[str], depth: int
) -> list[AuthoredState]:
    """Write some nested states."""
    made: list[AuthoredState] = []
    for number in range(data.draw(st.integers(2, 4))):
        if not labels:
            break
        label = labels.pop()
        kinds = [
            "activity",
            "wait",
            *(["final"] if number and depth else []),
            *(["compound"] * 3 if depth < 2 else []),
        ]
        match data.draw(st.sampled_from(kinds)):
            case "final":
                made.append(machine.final(label))
            case "compound":
                with machine.compound(label) as compound:
                    made += [compound, *write_states(machine, data, labels, depth + 1)]
            case kind:
                made.append(
                    machine.state(label, Activity(Do(MOVE)) if kind == "activity" else None)
                )
    return made


def write_arrows(states: list[AuthoredState], data: st.DataObject) -> None:
    """Give each state arrows that keep the machine sound, and some that may not."""
    for state in states:
        if state.kind is StateKind.FINAL:
            continue
        can_be_done = state.kind is StateKind.ACTIVITY or any(
            other.parent is state and other.kind is StateKind.FINAL for other in states
        )
        events = data.draw(st.sets(st.sampled_from(EVENTS[0 if can_be_done else 2 :]), min_size=1))
        for event in sorted(events | ({"done"} if can_be_done else set())):
            guards: list[str | None] = [
                *data.draw(st.sets(st.sampled_from(GUARDS), max_size=1)),
                None,
            ]
            for guard in guards:
                target = data.draw(st.sampled_from(states))
                likelihood = (
                    Prior(data.draw(st.sampled_from([0.0, 0.2, 0.4])))
                    if data.draw(st.booleans())
                    else None
                )
                when = None if guard is None else (lambda now, name=guard: now.facts[name])
                state.to(target, event, when=when, likelihood=likelihood, guard_name=guard or "")


def random_sound_machine(data: st.DataObject) -> Coordination:
    """Return a random sound machine."""
    try:
        with Coordination("random") as machine:
            write_arrows(write_states(machine, data, list(reversed(LABELS)), 0), data)
    except UnsoundMachine:
        assume(False)
    return machine


def expected_arrows(
    machine: Coordination, leaf: int, event: str, facts: dict[str, Any]
) -> list[TakenArrow]:
    """Return the arrows of the automaton that an event takes."""

    def is_taken(arrow: LikelyArrow, event: str) -> bool:
        return arrow.symbol in (event, *(f"{event} [{guard}]" for guard in GUARDS if facts[guard]))

    automaton = machine.automaton(Situation())
    taken = []
    while arrow := next((arrow for arrow in automaton.arcs(leaf) if is_taken(arrow, event)), None):
        taken.append(TakenArrow(leaf, arrow.symbol, arrow.target))
        leaf, event = arrow.target, "done"
        if machine.states[leaf].kind is not StateKind.FINAL:
            break
    return taken


@MOST_ARE_REFUSED
@given(st.data())
def test_machine_follows_its_automaton(data: st.DataObject) -> None:
    machine = random_sound_machine(data)
    check_definition(machine, machine.automaton(Situation()))
    run = machine.interpreter()
    for event in data.draw(st.lists(st.sampled_from(EVENTS), max_size=8)):
        run.take(event, Situation("", dict.fromkeys(GUARDS, True)))
    run.restart()
    assert run.current == machine.automaton(Situation()).initial
    for event in data.draw(st.lists(st.sampled_from(EVENTS), min_size=8, max_size=20)):
        facts = {guard: data.draw(st.booleans()) for guard in GUARDS}
        expected = expected_arrows(machine, run.current, event, facts)
        assert run.take(event, Situation("", facts)) == expected
        assert run.current == (expected[-1].after if expected else run.current)
        assert machine.states[run.current].kind in (StateKind.ACTIVITY, StateKind.WAIT)


def check_definition(machine: Coordination, automaton: FlatAutomaton) -> None:
    for state in machine.states:
        if state.kind is not StateKind.COMPOUND:
            arcs = automaton.arcs(state.number)
            symbols = [arc.symbol for arc in arcs]
            assert len(set(symbols)) == len(arcs), "one transition for each symbol"
            for before, symbol in combinations(symbols, 2):
                assert not symbol.startswith(f"{before} ["), "each of them can be taken"
            assert all(arc.likelihood >= 0 for arc in arcs)
            assert fsum(arc.likelihood for arc in arcs) <= 1 + 1e-9
            assert all(machine.states[arc.target].kind is not StateKind.COMPOUND for arc in arcs)
