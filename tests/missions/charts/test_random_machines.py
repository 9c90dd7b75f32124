"""Random machines. Each accepted machine runs and keeps the guarantees of soundness, however its
tasks end.
"""

from contextlib import suppress
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from missions.charts.played import ENDINGS, EndOfPlay, PlayedMission, PlayedTask
from sampling import lives

from tca_behaviours.missions.charts import Sequence, StateMachine, UnsoundMachine
from tca_behaviours.missions.charts.running import MachineRun
from tca_behaviours.missions.charts.soundness import endings_of
from tca_behaviours.missions.charts.statechart import Statechart
from tca_behaviours.missions.charts.states import MachineState
from tca_wire.charts import ActiveStates, Ending, StateKind

MOST_ARE_REFUSED = settings(
    max_examples=lives(20, soak=100), suppress_health_check=[HealthCheck.filter_too_much]
)
LABELS = [f"s{number}" for number in range(9)]


class RandomEndings(PlayedMission):
    """A played mission in which any task may end in any way."""

    def __init__(self, data: st.DataObject) -> None:
        super().__init__()
        self.data = data
        self.left = 25

    def first_ended(
        self, tasks: list[PlayedTask], timeout: float | None = None
    ) -> list[PlayedTask]:
        in_front = [
            task for task in self.running if task.name == "Task(True)" and task not in self.stopping
        ]
        assert len(in_front) <= 1, "tasks in the foreground stop each other"
        if not any(task in self.stopping for task in tasks):
            self.left -= 1
            if self.left < 0:
                raise EndOfPlay
            ended = self.data.draw(st.sampled_from(tasks))
            self._end(ended, self.data.draw(st.sampled_from(ENDINGS)), "")
        return super().first_ended(tasks, timeout)


def write_states(
    sm: StateMachine, data: st.DataObject, labels: list[str], depth: int, *, is_in_front: bool
) -> None:
    """Write some states. Most states have no transitions of their own, because few machines with
    many transitions are sound.
    """
    for _ in range(data.draw(st.integers(2, 3))):
        if not labels:
            return
        label = labels.pop()
        kind = data.draw(
            st.sampled_from(
                ["task", "task", "epsilon", "sequence", "any", "all"][: 6 if depth else 3]
            )
        )
        if kind == "task":
            state = sm.task("Task", label, foreground=is_in_front)
        elif kind == "epsilon":
            state = sm.epsilon(label)
        else:
            until: Any = kind
            with (
                sm.sequence(label)
                if kind == "sequence"
                else sm.concurrence(label, until=until) as state
            ):
                write_states(sm, data, labels, depth - 1, is_in_front=is_in_front)
        if state.parent is not None and state.parent.kind.is_concurrent:
            is_in_front = False  # at most one branch has the foreground
        possible = ["completed"] if kind == "epsilon" else ENDINGS
        targets: Any = {
            e: data.draw(st.sampled_from(LABELS))
            for e in possible
            if data.draw(st.integers(0, 5)) == 5
        }
        state.on(**targets)


def random_sound_machine(data: st.DataObject) -> StateMachine:
    """Return a random sound machine."""
    try:
        with Sequence("random") as sm:
            write_states(sm, data, list(reversed(LABELS)), 2, is_in_front=True)
    except UnsoundMachine:
        assume(False)
    return sm


@MOST_ARE_REFUSED
@given(st.data())
def test_sound_machine_keeps_its_guarantees_in_any_run(data: st.DataObject) -> None:
    sm = random_sound_machine(data)
    mission: Any = RandomEndings(data)
    published = list[ActiveStates]()
    run = MachineRun(sm.root, mission, published.append)
    with suppress(EndOfPlay):
        assert run.run_to_end().ending in endings_of(sm.root)[sm.root]
    assert not mission.running
    for active in published:
        states = [sm.chart.states[number] for number in active.active]
        assert any(state.kind is StateKind.TASK for state in states)
        for number, state in zip(active.active, states, strict=True):
            inside = [one for one in active.active if sm.chart.states[one].parent == number]
            assert state.kind is not StateKind.EPSILON
            assert state.parent in active.active or not number
            assert len(inside) == 1 or state.kind.is_concurrent or state.kind is StateKind.TASK


def explored(root: MachineState) -> tuple[set[MachineState], set[Ending]]:
    """Return the states that the statechart can enter and its possible endings, by exhaustive
    search.
    """
    entered, endings = set[MachineState](), set[Ending]()
    chart = Statechart(root, entered.add, lambda _: None)
    seen = set[tuple[MachineState, ...]]()
    paths: list[list[tuple[MachineState, Ending]]] = [[]]
    for path in paths:
        chart.begin()
        for step in path:
            chart.record_end(*step)
        if chart.ending is not None:
            endings.add(chart.ending)
        elif (active := tuple(chart.active)) not in seen:
            seen.add(active)
            tasks = [state for state in active if state.kind is StateKind.TASK]
            paths += [[*path, (task, ending)] for task in tasks for ending in ENDINGS]
    return entered, endings


@pytest.mark.soak
@MOST_ARE_REFUSED
@given(st.data())
def test_soundness_agrees_with_exhaustive_search(data: st.DataObject) -> None:
    """Each state can be entered, and exactly the computed endings are possible."""
    sm = random_sound_machine(data)
    assert explored(sm.root) == (set(sm.root.all()), set(endings_of(sm.root)[sm.root]))
