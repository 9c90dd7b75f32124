"""Promises of central for failures, wiretaps, monitors, suspension and time hold in every order of
events.
"""

import contextlib
import re
from typing import Any

import pytest
from explore import scenarios
from explore.scenarios import (
    BATTERY,
    CHECK,
    GAUGE,
    HIGHER,
    IS_LOW,
    RECHARGE,
    REST,
    SLIPPED,
    STEP,
    WALK,
    assert_good,
    counterexample,
)

import tca_tools.explore as tca
from tca_module import Condition, Inform, Recovery, Refused, Timeout, this
from tca_tools.explore import (
    achieved,
    at_most,
    at_most_in_all,
    before,
    begun,
    eventually,
    failed,
    fired,
    handled,
    killed,
    never,
    never_stuck,
    recovering,
    retried,
    sent,
    suspended,
)

# --- wiretaps -------------------------------------------------------------------------------------


@pytest.mark.parametrize("condition", [Condition.BEFORE_HANDLING, Condition.BEFORE_ACHIEVING])
def test_before_tap_holds_task_until_listener_ends(condition: Condition) -> None:
    in_turn = [before(achieved(CHECK, number), begun(STEP, number)) for number in (1, 2)]
    assert_good(
        scenarios.tapped(condition), *in_turn, at_most_in_all(2, fired(CHECK)), never_stuck()
    )


@pytest.mark.parametrize("safety_arrives_late", [False, True])
def test_late_tap_holds_queued_step(*, safety_arrives_late: bool) -> None:
    scenario = scenarios.tapped_late(safety_arrives_late=safety_arrives_late)
    assert_good(
        scenario,
        before(achieved(CHECK, 1), begun(STEP, 1)),
        at_most_in_all(1, fired(CHECK)),
        never_stuck(),
    )
    assert "queued: step {2} for legs" in counterexample(scenario, never(fired(CHECK)))


def test_when_tap_holds_end_of_task() -> None:
    assert_good(
        scenarios.tapped(Condition.WHEN_ACHIEVED),
        before(achieved(CHECK, 1), achieved(STEP, 1)),
        never_stuck(),
    )


@pytest.mark.parametrize("condition", [Condition.WHILE_ACHIEVING, Condition.AFTER_ACHIEVED])
def test_while_and_after_taps_hold_nothing(condition: Condition) -> None:
    story = counterexample(
        scenarios.tapped(condition), before(achieved(CHECK, 1), achieved(STEP, 2))
    )
    assert "tapped: {1} for step {2}: check {3}" in story


def test_tap_with_at_once_fires_exactly_once() -> None:
    notice = Inform("told")

    def tapped(*, at_once: bool) -> tca.Scenario:
        scenario = tca.Scenario("tapped at once")
        scenario.module("legs").handles(STEP)(scenarios.nothing)
        scenario.module("log").handles(notice)(scenarios.nothing)

        @scenario.module("user").does
        def story(me: tca.Script) -> None:
            step = me.command(STEP)
            with contextlib.suppress(Refused):  # it has ended
                me.tap(Condition.AFTER_ACHIEVED, step, notice, at_once=at_once)

        return scenario

    assert_good(
        tapped(at_once=True),
        at_most_in_all(1, sent(notice)),
        eventually(sent(notice)),
        never_stuck(),
    )
    counterexample(tapped(at_once=False), eventually(sent(notice)))


# --- failures -------------------------------------------------------------------------------------


def is_handled_twice(world: tca.World) -> list[tca.Seen]:
    handlers = [seen.message for seen in world.messages if seen.is_handled]
    return [seen for seen in world.messages if seen.is_handled and handlers.count(seen.message) > 1]


def test_recovery_ladder_always_ends() -> None:
    """The ladder is retry, replan, give up. Each level tries twice at most, and all waits end."""
    bounds = (
        at_most_in_all(2, retried(STEP)),
        at_most_in_all(1, retried(WALK)),
        at_most_in_all(4, sent_or_retried),
        at_most(1, recovering(STEP)),
    )
    result = assert_good(scenarios.ladder(), *bounds, never(is_handled_twice), never_stuck())
    assert result.longest is not None  # no run is endless
    counterexample(scenarios.ladder(), eventually(retried(STEP)))  # no slip is possible, too


def sent_or_retried(world: tca.World) -> list[tca.Seen]:
    """Return the steps that the last action sent or retried."""
    return [
        seen
        for seen in world.tasks
        if seen.message == STEP.name and (seen.is_new or seen.is_retried)
    ]


@pytest.mark.soak
def test_endless_recovery_ladder_is_found() -> None:
    story = counterexample(scenarios.ladder(gives_up=False), at_most_in_all(2, retried(WALK)))
    assert "it has happened 3 times: walk {2}" in story


def test_counterexample_shows_each_recovery_action() -> None:
    story = counterexample(scenarios.ladder(), never(failed(WALK)))
    for line in (
        "1. user attaches higher for slipped to all step",
        '2. user sends goal walk "straight", with replan for slipped',
        "5. legs in step {4} chooses slips, fails: slipped",
        '6. expert in higher {5} retries step {4} with "higher"',
        "9. expert in higher {7} reissues its failure",
        '10. expert in replan {8} retries walk {2} with "another way"',
    ):
        assert line in story, story


def retried_while_running(*properties: Any) -> tca.Scenario:
    """Return a scenario: a user retries a step whose handler runs."""
    scenario = tca.Scenario("retried while it runs", *properties)
    scenario.module("legs", capacity=2).handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        step = me.command(STEP)
        with contextlib.suppress(Refused):  # it has ended
            step.retry(STEP, "again")
        step.wait()

    return scenario


def test_retried_task_has_one_handler_at_a_time() -> None:
    result = assert_good(retried_while_running(), at_most(1, handled(STEP)), never_stuck())
    assert result.longest is not None
    counterexample(retried_while_running(), never(achieved(STEP, "again")))


def test_failure_raised_from_outside_leaves_nothing_stuck() -> None:
    scenario = tca.Scenario("raised from outside")
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("expert").handles(HIGHER)
    def higher(task: tca.Task) -> None:
        task.trouble.failing.kill()

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        step = me.command(STEP, on_failure=[Recovery(SLIPPED, HIGHER)])
        step.fail(SLIPPED(text="seen from afar"))

    assert_good(scenario, never_stuck(), at_most(1, recovering(STEP)))
    assert "user raises slipped on step {1}" in counterexample(scenario, never(failed(STEP)))


# --- suspension -----------------------------------------------------------------------------------


def test_suspended_subtree_starts_nothing() -> None:
    """Every scenario checks that no suspended task is delivered. In this scenario a task is
    suspended.
    """
    result = assert_good(
        scenarios.suspending(),
        never(starts_suspended),
        before(achieved(WALK), achieved(REST)),
        never_stuck(),
    )
    assert result.longest is not None
    assert "the operator suspends walk {1}" in counterexample(
        scenarios.suspending(), never(suspended(STEP))
    )


def test_suspended_new_tasks_can_be_ordered() -> None:
    assert_good(
        scenarios.ordered(suspended=True), before(achieved(STEP, 2), begun(STEP, 1)), never_stuck()
    )
    assert_good(scenarios.ordered(suspended=True, kills=2), never(failed(WALK)), never_stuck())
    counterexample(scenarios.ordered(suspended=False), never(failed(WALK)))


def starts_suspended(world: tca.World) -> list[tca.Seen]:
    return [seen for seen in world.tasks if seen.is_suspended and seen.is_new and seen.is_begun]


# --- time -----------------------------------------------------------------------------------------


@pytest.mark.soak
def test_deadline_during_reply_leaves_nothing_stuck() -> None:
    assert (
        assert_good(scenarios.late(), eventually(achieved(REST)), never_stuck()).longest is not None
    )
    is_retried_once = at_most_in_all(1, retried(STEP))  # a retry gets no new deadline
    assert (
        assert_good(
            scenarios.late(handled=True), eventually(achieved(REST)), is_retried_once, never_stuck()
        ).longest
        is not None
    )
    assert "5 s pass" in counterexample(scenarios.late(), never(killed(STEP)))
    counterexample(scenarios.late(), never(achieved(STEP)))  # the step may also be in time


@pytest.mark.soak
@pytest.mark.parametrize(
    ("options", "fires"),
    [({"maximum": 2}, 2), ({"maximum": 1, "fire_every": 2}, 1), ({"duration": 2.5}, 3)],
)
def test_polling_monitor_acts_up_to_its_bound(options: dict[str, Any], fires: int) -> None:
    assert_good(
        scenarios.polling(BATTERY, **options), at_most_in_all(fires, fired(RECHARGE)), never_stuck()
    )
    counterexample(
        scenarios.polling(BATTERY, **options), at_most_in_all(fires - 1, fired(RECHARGE))
    )


def test_endless_polling_has_finitely_many_states() -> None:
    result = assert_good(scenarios.polling(GAUGE, waited_for=True), at_most(1, sent(GAUGE)))
    assert result.longest is None
    assert result.states < 10


def test_no_task_starts_before_its_delay() -> None:
    scenario = tca.Scenario("delays", never_stuck())
    scenario.module("legs", capacity=2).handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        first = me.command(STEP, 1, delay=1.0)
        me.command(
            STEP,
            2,
            sequential=False,
            constraints=[first.handling.end + 2.0 <= this.achieving.start],
        )

    assert_good(
        scenario,
        before(lambda world: world.now >= 1, begun(STEP, 1)),
        before(achieved(STEP, 1), begun(STEP, 2)),
        before(lambda world: world.now >= 3, begun(STEP, 2)),
    )
    story_of_it = counterexample(scenario, never(achieved(STEP, 2)))
    assert re.search(r"\n  \d\. 1 s pass\n.*\n  \d\. 2 s pass\n", story_of_it, re.DOTALL)


def test_wait_with_timeout_may_time_out() -> None:
    scenario = tca.Scenario("impatient")
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        step = me.command(STEP)
        try:
            step.wait(timeout=2.0)
        except Timeout:
            step.kill("too slow")

    assert_good(scenario, never_stuck())
    counterexample(scenario, never(achieved(STEP)))
    assert "user times out and no longer waits for end achieving of step {1}" in counterexample(
        scenario, never(killed(STEP))
    )


# --- kills ----------------------------------------------------------------------------------------


def parting(*properties: Any) -> tca.Scenario:
    """Return a scenario: a walk with a termination message is killed a while after its planning."""
    scenario = tca.Scenario("parting", *properties)

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        task.ref.on_termination(REST)
        task.ref.kill(after=task.planning.end, delay=1.0)
        task.command(STEP)

    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("couch").handles(REST)(lambda _: None)
    scenario.module("user").does(lambda me: me.goal(WALK).wait())
    return scenario


def walk_is_over(world: tca.World) -> list[tca.Seen]:
    return [
        seen
        for seen in world.tasks
        if seen.message == WALK.name and seen.is_killed and seen.is_over
    ]


def test_killed_goal_sends_its_termination_message() -> None:
    assert_good(
        parting(),
        before(achieved(REST), walk_is_over),
        before(killed(WALK), sent(REST)),
        never_stuck(),
    )
    counterexample(parting(), never(killed(WALK)))
    counterexample(parting(), never(achieved(WALK)))


def test_foreign_monitor_ends_with_its_running_task() -> None:
    scenario = tca.Scenario("watched from outside")
    legs, user, watcher = (
        scenario.module("legs"),
        scenario.module("user"),
        scenario.module("watcher"),
    )
    legs.handles(STEP)(lambda _: None)
    scenario.module("body").handles(IS_LOW)(lambda _: False)
    user.does(lambda me: me.command(STEP).wait())
    too_late = []

    @watcher.does
    def watch(me: tca.Script) -> None:
        for step in me.tasks(STEP):
            try:
                me.under(step).monitor(GAUGE, period=1.0).id  # noqa: B018
            except Refused as refused:
                too_late.append(refused.text)

    assert_good(scenario, eventually(achieved(STEP)), never_stuck())
    assert "nothing can be added under it" in too_late[0]
    counterexample(scenario, never(achieved(GAUGE)))
