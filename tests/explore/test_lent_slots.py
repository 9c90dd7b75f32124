"""Handlers that need tasks of their own resource: each task ends, in every order of events."""

from typing import Any

import pytest
from explore.accepting import has_ended
from explore.scenarios import STEP, WALK, assert_good

import tca_tools.explore as tca
from tca_module import Inform
from tca_tools.explore import eventually, never_stuck

STOPPED = Inform("stopped")


def test_handler_that_waits_for_its_own_resource_ends() -> None:
    scenario = tca.Scenario("spawn with wait", never_stuck(), eventually(has_ended(WALK)))
    legs, user = scenario.module("legs"), scenario.module("user")

    @legs.handles(WALK)
    def walk(task: tca.Task) -> None:
        task.command(STEP, False)
        task.command(STEP, True).wait()

    legs.handles(STEP)(lambda _, __: None)

    @user.does
    def use(me: tca.Script) -> None:
        me.command(STEP, False)
        me.goal(WALK)

    assert_good(scenario)


@pytest.mark.parametrize("frees_slot", [False, True])
def test_task_below_a_postponed_handler_ends(*, frees_slot: bool) -> None:
    """The sensor gets its message from the last step, so the reply comes after that step."""
    scenario = tca.Scenario("postponed", never_stuck(), eventually(has_ended(WALK)))
    legs, user = scenario.module("legs"), scenario.module("user")

    @legs.handles(WALK)
    def walk(task: tca.Task) -> Any:
        task.command(STEP, True)
        later = task.reply_later(frees_slot=frees_slot)
        task.keep_reply(later, lambda later, _: later.reply())
        return later

    @legs.handles(STEP)
    def step(task: tca.Task, is_last: bool) -> None:
        if is_last:
            task.inform(STOPPED)

    @legs.handles(STOPPED, resource=legs.resource("sensor"))
    def stopped(task: tca.Task) -> None:
        task.use_kept(WALK)

    @user.does
    def use(me: tca.Script) -> None:
        me.command(STEP, False)
        me.goal(WALK)

    assert_good(scenario)
