"""Later replies: each task ends, in every order of events."""

from typing import Any

import pytest
from explore.accepting import has_ended
from explore.scenarios import HIGHER, STEP, WALK, assert_good, counterexample, resolves

import tca_tools.explore as tca
from tca_module import Failure, Inform, LaterReply, Recovery
from tca_tools.explore import (
    Seen,
    World,
    achieved,
    at_most_in_all,
    eventually,
    failed,
    handled,
    never,
    never_stuck,
    sent,
)
from tca_wire.messages.failures import FORGOTTEN

THERE = Inform("there")


def carry_out(task: tca.Task, owed: LaterReply[Any], order: str) -> None:
    """Use an owed reply as *order*, the sensor's order, says."""
    request = owed.request if order == "accept" else None
    if order == "reply" or (order == "obey" and not owed.cancelled):
        owed.reply(1)
    elif order == "accept":
        if request is not None:
            request.accept()
        task.keep_reply(owed, lambda owed, order: carry_out(task, owed, order))


def owed_scenario(
    order: str, *properties: tca.Property, keeps: bool = True, **legs: Any
) -> tca.Scenario:
    """Return a scenario: legs leave the reply of a step to their sensor, and then take another
    step.
    """
    scenario = tca.Scenario(
        f"{order} later", never_stuck(), eventually(has_ended(STEP, False)), *properties
    )
    planner, feet, user = (
        scenario.module("planner"),
        scenario.module("legs", **legs),
        scenario.module("user"),
    )

    @feet.handles(STEP, takes=["cancel"])
    def step(task: tca.Task, is_last: bool) -> Any:
        if is_last:
            return None
        task.inform(THERE)
        owed = task.reply_later()
        if keeps:
            task.keep_reply(owed, lambda owed, order: carry_out(task, owed, order))
        return owed

    @feet.handles(THERE, resource=feet.resource("sensor"))
    def there(task: tca.Task) -> None:
        if order:
            task.use_kept(STEP, order)

    @planner.handles(WALK)
    def walk(task: tca.Task) -> None:
        task.command(STEP, False)

    planner.handles(HIGHER, resource=planner.resource("head"))(resolves)

    @user.does
    def story(me: tca.Script) -> None:
        if order == "accept":
            me.command(STEP, False).cancel()
            me.inform(THERE)
        else:
            me.goal(WALK, on_failure=[Recovery(Failure(FORGOTTEN), HIGHER)])
        me.command(STEP, True)

    return scenario


def cancelled(world: World) -> list[Seen]:
    return [task for task in world.tasks if task.is_over and task.state == "cancelled"]


def test_kept_reply_is_sent_by_another_handler() -> None:
    assert_good(owed_scenario("reply"), eventually(achieved(STEP)), never(failed(STEP)))


@pytest.mark.soak
@pytest.mark.parametrize("keeps", [True, False])
def test_dropped_reply_is_failure_for_parent_task(*, keeps: bool) -> None:
    assert_good(
        owed_scenario("drop", keeps=keeps),
        eventually(failed(STEP)),
        eventually(handled(HIGHER)),
        at_most_in_all(1, sent(HIGHER)),
    )


@pytest.mark.soak
@pytest.mark.parametrize("order", ["reply", "drop", "obey"])
def test_kept_reply_of_killed_task_frees_its_slot(order: str) -> None:
    scenario = owed_scenario(order)
    scenario.may_kill(STEP)
    assert_good(scenario)


@pytest.mark.soak
def test_accepted_cancel_ends_owed_reply() -> None:
    assert_good(owed_scenario("accept"), eventually(cancelled), never(failed(STEP)))


def test_kept_reply_fails_when_its_module_leaves() -> None:
    assert "step {3} fails: module lost" in counterexample(
        owed_scenario("", never(failed(STEP)), may_leave=True)
    )


@pytest.mark.soak
@pytest.mark.parametrize("order", ["reply", "drop", "accept"])
def test_kept_reply_is_lost_with_its_module(order: str) -> None:
    assert_good(owed_scenario(order, may_be_lost=1, comes_back=True), limit=20_000)


def test_kept_reply_that_is_never_sent_is_found() -> None:
    assert "legs in step {3} owes its reply" in counterexample(owed_scenario(""))


@pytest.mark.soak
@pytest.mark.parametrize(
    ("broken", "order"), [("_on_dropped", "drop"), ("_send", "reply"), ("_on_stop", "accept")]
)
def test_library_that_never_replies_is_found(
    broken: str, order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LaterReply, broken, lambda _: None)
    assert "has not ended" in counterexample(owed_scenario(order))


@pytest.mark.parametrize(
    ("returns", "words"),
    [(1, "must return the LaterReply"), (None, r"kept without keep_reply\(\)")],
)
def test_misused_later_reply_is_scenario_error(returns: object, words: str) -> None:
    owed: list[LaterReply[Any]] = []

    def step(task: tca.Task) -> object:
        owed.append(task.reply_later())
        return returns or owed[-1]

    scenario = tca.Scenario("other")
    scenario.module("legs").handles(STEP)(step)
    scenario.module("user").does(lambda me: [me.command(STEP)])
    with pytest.raises(tca.ScenarioError, match=words):
        tca.explore(scenario)
