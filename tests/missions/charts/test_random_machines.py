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
from tca_behaviours.missions.charts.user_data import UserData
from tca_wire.charts import ActiveStates, StateKind

MOST_ARE_REFUSED = settings(
    max_examples=lives(10, soak=100), suppress_health_check=[HealthCheck.filter_too_much]
)
LEAVES = (StateKind.TASK, StateKind.CALL)
LABELS = [f"s{number}" for number in range(9)]


class RandomEndings(PlayedMission):
    """A played mission in which any task may end in any way."""

    def __init__(self, data: st.DataObject) -> None:
        super().__init__()
        self.data = data
        self.left = 25

    def count(self, _: object = None) -> None:
        """Count an event; end the play after a number of them."""
        self.left -= 1
        if self.left < 0:
            raise EndOfPlay

    def first_ended(
        self, tasks: list[PlayedTask], timeout: float | None = None
    ) -> list[PlayedTask]:
        in_front = [
            task for task in self.running if task.name == "Task(True)" and task not in self.stopping
        ]
        assert len(in_front) <= 1, "tasks in the foreground stop each other"
        if not any(task in self.stopping for task in tasks):
            self.count()
            if timeout is not None and self.data.draw(st.booleans()):
                self.now += timeout
                return []
            ended = self.data.draw(st.sampled_from(tasks))
            self._end(ended, self.data.draw(st.sampled_from(ENDINGS)), "")
        return super().first_ended(tasks, timeout)


class Answers:
    """A Python state that returns any of its outcomes."""

    outcomes = ("completed", "again")

    def __init__(self, data: st.DataObject) -> None:
        self.data = data

    def __call__(self, _: UserData) -> str:
        return self.data.draw(st.sampled_from(self.outcomes))


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
                ["task", "task", "epsilon", "call", "sequence", "any", "all", "all ended"][
                    : 8 if depth else 4
                ]
            )
        )
        if kind == "task":
            state = sm.task("Task", label, foreground=is_in_front)
        elif kind == "epsilon":
            state = sm.epsilon(label)
        elif kind == "call":
            state = sm.call(Answers(data), label)
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
        possible: Any = {"epsilon": ["completed"], "call": [*Answers.outcomes, "failed"]}
        chosen = [e for e in possible.get(kind, ENDINGS) if data.draw(st.integers(0, 5)) == 5]
        targets: Any = {e: data.draw(st.sampled_from([*LABELS, "timeout"])) for e in chosen}
        if kind == "call" and "again" not in targets:
            targets["again"] = "completed"
        state.on(**targets)
        if kind not in ("epsilon", "call") and data.draw(st.integers(0, 5)) == 5:
            state.after(data.draw(st.sampled_from([1.0, 2.0])), data.draw(st.sampled_from(LABELS)))


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

    def publish(states: ActiveStates) -> None:
        mission.count()
        published.append(states)

    run = MachineRun(sm.root, mission, publish, clock=lambda: mission.now)
    with suppress(EndOfPlay):
        assert run.run_to_end().ending in endings_of(sm.root)[sm.root]
    assert not mission.running
    for active in published:
        states = [sm.chart.states[number] for number in active.active]
        assert any(state.kind in LEAVES for state in states)
        for number, state in zip(active.active, states, strict=True):
            inside = [one for one in active.active if sm.chart.states[one].parent == number]
            assert state.kind is not StateKind.EPSILON
            assert state.parent in active.active or not number
            assert len(inside) == 1 or state.kind.is_concurrent or state.kind in LEAVES


def explored(root: MachineState) -> tuple[set[MachineState], set[str]]:
    """Return the states that the statechart can enter and its possible endings, by exhaustive
    search.
    """
    entered, endings = set[MachineState](), set[str]()
    chart = Statechart(root, entered.add, lambda _: None)
    seen = set[tuple[object, ...]]()
    paths: list[list[tuple[MachineState, str]]] = [[]]
    for path in paths:
        chart.begin()
        for step in path:
            if step[1]:
                chart.record_end(*step)
            else:
                chart.record_time(step[0])
        if chart.ending is not None:
            endings.add(chart.ending)
        elif (present := (*chart.active, *map(str, chart._ended.items()))) not in seen:
            seen.add(present)
            for state in chart.active:
                own = (*state.outcomes, "failed") if state.kind is StateKind.CALL else ENDINGS
                events = [*(own if state.kind in LEAVES else ()), *([""] if state.timed else [])]
                paths += [[*path, (state, event)] for event in events]
    return entered, endings


@pytest.mark.soak
@MOST_ARE_REFUSED
@given(st.data())
def test_soundness_agrees_with_exhaustive_search(data: st.DataObject) -> None:
    """Each state can be entered, and exactly the computed endings are possible."""
    sm = random_sound_machine(data)
    assert explored(sm.root) == (set(sm.root.all()), set(endings_of(sm.root)[sm.root]))
