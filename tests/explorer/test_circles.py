"""A run that goes on for ever, as it is shown: it can be played, comes back to where it was, and leaves nobody out."""

from typing import Any

import pytest
from explorer.scenarios import LIFT, NOTE, STEP, WALK

from tca_explorer import (
    Property,
    Result,
    Scenario,
    Script,
    Task,
    achieved,
    begun,
    eventually,
    explore,
    never_stuck,
    report,
)
from tca_explorer.play.play import Action, ActionKind, Play
from tca_explorer.search.fingerprint import Detail, fingerprint
from tca_module import Outcome, PollingMonitor, Query

IS_LOW: Query[None, bool] = Query("is low", reply=bool)
GAUGE = PollingMonitor("gauge", condition=IS_LOW)
WATCHED = Detail(names=True)


def needed(play: Play) -> set[tuple[str, str]]:
    """What can happen, and need happen some time."""
    return {(action.kind, action.name) for action in play.actions() if not action.is_optional}


def goes_round(result: Result) -> tuple[Action, ...]:
    """The way round, which has been gone twice."""
    assert result.violation is not None, report(result)
    circle = result.violation.circle
    assert circle
    play = Play(result.scenario)
    for action in result.violation.actions:
        play.perform(action)
    start, left_out = fingerprint(play, (), WATCHED), needed(play)
    for _ in range(2):
        for action in circle:
            assert action in play.actions()
            play.perform(action)
            left_out = (left_out & needed(play)) - {(action.kind, action.name)}
        assert fingerprint(play, (), WATCHED) == start
    assert not left_out, f"{left_out} can happen all the time, and never does"
    return circle


def looked_at(*properties: Property, readers: int = 1) -> Scenario:
    """Gauges that are looked at every second for ever; each look is another step of whoever looks."""
    scenario = Scenario("looked at", *properties)
    scenario.module("battery", capacity=readers).handles(IS_LOW)(lambda _: False)

    @scenario.module("user").does
    def story(me: Script) -> None:
        for _ in range(readers):
            me.monitor(GAUGE, period=1.0, for_ever=True)

    return scenario


def hangs(task: Task) -> None:
    task.hang()


def is_watched_over(task: Task) -> None:
    task.monitor(GAUGE, period=1.0)


def is_a_step(task: Task) -> None:
    task.command(STEP)


@pytest.mark.parametrize("one", [eventually(achieved(WALK)), never_stuck()])
def test_beside_a_gauge(one: Property) -> None:
    scenario = looked_at(one)
    scenario.module("planner").handles(WALK)(hangs)
    scenario.module("walker").does(lambda me: [me.goal(WALK)])
    circle = goes_round(explore(scenario))
    assert len(circle) == 2, "a second passes, and the question is answered"


def test_beside_two_gauges_both_are_looked_at() -> None:
    scenario = looked_at(eventually(achieved(WALK)), readers=2)
    scenario.module("planner").handles(WALK)(hangs)
    scenario.module("walker").does(lambda me: [me.goal(WALK)])
    assert {action.name for action in goes_round(explore(scenario))} == {"", "battery/1", "battery/2"}


@pytest.mark.soak
def test_two_who_play_ball_beside_two_who_do() -> None:
    """Each pair could go on for ever without the other: that would be no accident, and is not shown."""
    scenario = Scenario("ball", eventually(achieved(WALK)))
    for name in ("here", "there"):
        ball: Any = type(NOTE)(f"ball {name}")
        scenario.module(name).handles(ball)(lambda task, ball=ball: task.inform(ball))
        scenario.module(f"{name} begins").does(lambda me, ball=ball: me.inform(ball))
    scenario.module("planner").handles(WALK)(hangs)
    scenario.module("walker").does(lambda me: [me.goal(WALK)])
    assert {action.name for action in goes_round(explore(scenario))} == {"here/1", "there/1"}


def test_what_need_not_happen_may_be_left_out_for_ever() -> None:
    """That a module can be lost all the time does not mean that it is."""
    scenario = looked_at(eventually(lambda world: "battery" not in world.modules))
    scenario.modules["battery"].may_be_lost = 1
    circle = goes_round(explore(scenario))
    assert {action.kind for action in circle} == {ActionKind.TIME, ActionKind.STEP}


def test_what_cannot_happen_all_the_time_may_be_left_out_for_ever() -> None:
    """A step that is done each time before its deadline: time need not pass, for in between nothing is due."""
    scenario = Scenario("in time", eventually(begun(LIFT)))

    @scenario.module("ear").handles(NOTE)
    def on_note(task: Task) -> None:
        in_time = task.command(STEP, deadline=1.0).wait() is Outcome.DONE
        if in_time:
            task.inform(NOTE)
        else:
            task.command(LIFT)

    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("arm").handles(LIFT)(lambda _: None)
    scenario.module("pinger").does(lambda me: me.inform(NOTE))
    assert {action.name for action in goes_round(explore(scenario))} == {"ear/1", "legs/1"}


def test_a_goal_that_waits_for_what_is_under_it_waits_for_nobody_else() -> None:
    """It is what is under it that goes on, or is stuck."""
    scenario = looked_at(never_stuck())
    scenario.module("planner").handles(WALK)(is_watched_over)
    scenario.module("walker").does(lambda me: [me.goal(WALK)])
    result = explore(scenario)
    assert result.ok, report(result)
    assert result.longest is None


def test_what_is_stuck_under_a_goal_is_named_and_not_the_goal() -> None:
    scenario = looked_at(never_stuck())
    scenario.module("planner").handles(WALK)(is_a_step)
    scenario.module("legs", may_be_lost=1).handles(STEP)(lambda _: None)
    scenario.module("walker").does(lambda me: [me.goal(WALK)])
    result = explore(scenario)
    goes_round(result)
    assert result.violation is not None
    assert result.violation.why.startswith("this can go on for ever, and all the while:\nstep {")
