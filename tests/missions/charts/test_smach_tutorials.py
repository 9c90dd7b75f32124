"""What the tutorials of SMACH teach, as machines of this library: states that count, a machine in a
machine, user data under other names, and concurrences that end by combination.
"""

from collections.abc import Callable

import pytest
from missions.charts.played import Played
from missions.rover import mission_of_rover

from tca_behaviours.missions import MissionTaskFailed
from tca_behaviours.missions.charts import (
    Concurrence,
    FromData,
    Sequence,
    StateMachine,
    UnknownUserData,
    UserData,
    state,
)


@state(outcomes=["outcome1", "outcome2"])
def foo(data: UserData) -> str:
    if data.counter >= 3:
        return "outcome2"
    data.counter += 1
    return "outcome1"


@state(outcomes=["outcome1"])
def bar(_: UserData) -> str:
    return "outcome1"


def afters(run: Played) -> list[str]:
    return [one.after for one in run.published]


def test_foo_and_bar_alternate_until_the_own_outcome() -> None:
    with StateMachine("simple", outcomes=["outcome4"]) as sm:
        sm.call(foo, "FOO").on(outcome1="BAR", outcome2="outcome4")
        sm.call(bar, "BAR").on(outcome1="FOO")
    with mission_of_rover() as (mission, _):
        data = {"counter": 1}
        end = sm.run(mission, data=data)
    assert (end.outcome, end.text) == ("outcome4", "FOO has ended as outcome2")
    assert data == {"counter": 3}


def test_nested_machine_maps_its_outcome() -> None:
    with StateMachine("top", outcomes=["outcome5"]) as sm:
        sm.call(bar, "BAS").on(outcome1="SUB")
        with sm.machine("SUB", outcomes=["outcome4"]).on(outcome4="outcome5"):
            sm.call(foo, "FOO").on(outcome1="BAR", outcome2="outcome4")
            sm.call(bar, "BAR").on(outcome1="FOO")
    run = Played(sm, data={"counter": 2})
    assert run.end == ("outcome5", "FOO has ended as outcome2")
    assert run.active == [["BAS"], ["SUB", "FOO"], ["SUB", "BAR"], ["SUB", "FOO"]]


def add_one(data: UserData) -> None:
    data.sum = data.used = data.number + 1
    del data.used
    with pytest.raises(UnknownUserData):
        del data.used


def test_user_data_pass_under_other_names() -> None:
    with Sequence("data") as sm:
        sm.call(add_one, "FOO", remap={"number": "x", "sum": "x"})
        with sm.sequence("SUB", remap={"inner": "x"}):
            sm.call(add_one, "BAR", remap={"number": "inner", "sum": "y"})
            sm.Drive(x=FromData("inner"), gear=FromData("y"))
    run = Played(sm, "Drive completed", data={"x": 1})
    assert run.data == {"x": 2, "y": 3}
    assert run.happened[0] == "start Drive(2,3)"


def always(outcome: str) -> Callable[[UserData], str]:
    @state(outcomes=["outcome1", "outcome2", "outcome3"])
    def function(_: UserData) -> str:
        return outcome

    return function


@pytest.mark.parametrize(
    ("foo_ends", "bar_ends", "outcome"),
    [
        ("outcome2", "outcome1", "outcome5"),
        ("outcome3", "outcome2", "outcome6"),
        ("outcome1", "outcome1", "outcome4"),
    ],
)
def test_concurrence_ends_by_combination(foo_ends: str, bar_ends: str, outcome: str) -> None:
    with Concurrence(
        "both",
        until="all ended",
        default="outcome4",
        outcome_map={
            "outcome5": {"FOO": "outcome2", "BAR": "outcome1"},
            "outcome6": {"FOO": "outcome3"},
        },
    ) as sm:
        sm.call(always(foo_ends), "FOO")
        sm.call(always(bar_ends), "BAR")
    run = Played(sm)
    assert run.end is not None
    assert run.end.ending == outcome
    assert run.active == [["FOO", "BAR"], ["BAR"]]


def test_concurrence_ends_when_its_function_says_so() -> None:
    """The policy of SMACH's child_termination_cb: BAR's end alone ends nothing."""
    seen = []

    def until(ended: dict[str, str]) -> bool:
        seen.append(ended)
        return "FOO" in ended

    found = {"found": {"FOO": "completed", "BAZ": "interrupted"}}
    with Concurrence("watch", until=until, outcome_map=found) as sm:
        sm.Look("FOO", foreground=False)
        sm.Listen("BAR", foreground=False)
        sm.Turn("BAZ")
    run = Played(sm, "Listen failed", "Look completed")
    assert run.end == ("found", "FOO has completed")
    assert seen == [{"BAR": "failed"}, {"BAR": "failed", "FOO": "completed"}]
    assert run.happened[-2:] == ["stop Turn", "Turn interrupted"]


def test_concurrence_waits_though_one_failed() -> None:
    with Concurrence("all", until="all ended") as sm:
        sm.Look(foreground=False)
        sm.Turn()
    run = Played(sm, "Look timeout", "Turn failed")
    assert run.end == ("timeout", "Look was not done in time")
    assert "stop Turn" not in run.happened
    assert Played(sm, "Look completed", "Turn completed").end == ("completed", "Turn has completed")


def divide(_: UserData) -> None:
    raise ZeroDivisionError


def test_error_in_a_python_state_is_its_failure(caplog: pytest.LogCaptureFixture) -> None:
    with Sequence("broken") as sm:
        sm.call(divide, "FOO").on(failed="BAR")
        sm.call(lambda data: data.missing, "BAR")
    with (
        mission_of_rover() as (mission, _),
        pytest.raises(MissionTaskFailed, match="user data 'missing', which are not set"),
    ):
        sm.run(mission)
    foo, bar = caplog.records
    assert "'FOO'" in foo.message
    assert "'BAR'" in bar.message
    assert "ZeroDivisionError" in caplog.text
    assert "running.py" not in caplog.text


def test_error_in_until_names_the_concurrence(caplog: pytest.LogCaptureFixture) -> None:
    def broken(ended: dict[str, str]) -> bool:
        return ended["typo"] == "completed"

    with Concurrence("both", until=broken) as sm:
        sm.Watch(foreground=False)
        sm.call(lambda _: None)
    with (
        mission_of_rover() as (mission, _),
        pytest.raises(MissionTaskFailed, match=r"until=broken of concurrence 'both'.*'typo'"),
    ):
        sm.run(mission)
    assert 'ended["typo"]' in caplog.text
    assert "statemachine" not in caplog.text


def test_end_of_a_task_becomes_user_data() -> None:
    with Sequence("weigh") as sm:
        sm.Weigh(grams=FromData("sample")).keep_end("weight")
        sm.call(lambda data: setattr(data, "text", data.weight.text), "read")
    with mission_of_rover() as (mission, _):
        data: dict[str, object] = {"sample": [2, 3]}
        sm.run(mission, data=data)
    assert data["text"] == "5 g"
