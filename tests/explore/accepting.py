"""A robot with one request about a task. Much may happen before central has carried out the
request.
"""

from collections.abc import Callable
from typing import Any

from explore.scenarios import LIFT, SLIPPED, STEP, WALK, assert_good

import tca_tools.explore as tca
from tca_module import ExceptionHandler
from tca_module.sending.task_ref import TaskRef
from tca_tools.explore import accepted, never, never_stuck
from tca_wire.messages.declarations import Message

HELP: ExceptionHandler[None] = ExceptionHandler("help")

LOST: dict[str, Any] = {"may_be_lost": 1, "comes_back": True}

EVENTUALLY = 1e6  # seconds: longer than every timer

LONG = 100.0  # seconds: longer than the limits of requests

BETWEEN = {
    "loss of server": "lose legs",
    "failure and retry": "slip, kill step",
    "kills": "kill step, kill walk",
    "loss of operator": "lose operator",
    "suspension": "suspend walk, kill step",
    "loss of client": "lose planner",
}
"""The disturbances of each scenario. They may happen at any time. Only soak runs try every pair;
the order of rows makes the other runs' pairs cheap.
"""


def robot(title: str, ask: Callable[[Any, TaskRef], object], between: str = "") -> tca.Scenario:
    """Return a scenario: a user's walk has one step. The planner makes the request, or an operator
    that finds the step does.
    """

    def module(name: str) -> tca.ScenarioModule:
        is_lost = f"lose {name}" in between
        return scenario.module(
            name, may_be_lost=int(is_lost), comes_back=is_lost and name != "operator"
        )

    scenario = tca.Scenario(title)
    by_operator = "operator" in between
    planner, legs, others, user = map(module, ("planner", "legs", "others", "user"))
    others.handles(LIFT)(lambda _: None)

    @planner.handles(WALK)
    def walk(task: tca.Task) -> None:
        step = task.command(STEP)
        if not by_operator:
            ask(task, step)

    @legs.handles(STEP)
    def step(task: tca.Task) -> None:
        if "last" in between:
            task.command(LIFT, delay=LONG).wait()
        if "slip" in between and task.choose("holds", "slips") == "slips":
            raise SLIPPED(text="ice")

    @others.handles(HELP)
    def help_once(task: tca.Task) -> None:
        if task.trouble.attempts > 1:
            raise task.trouble.reissue()
        task.trouble.failing.retry()

    @user.does
    def story(me: tca.Script) -> None:
        if "slip" in between:
            me.on_failure(SLIPPED, HELP, of=STEP)
        me.goal(WALK)

    if by_operator:

        @module("operator").does
        def finds(me: tca.Script) -> None:
            for step in me.tasks(STEP):
                ask(me, step)

    if "kill step" in between:
        scenario.may_kill(STEP)
    if "kill walk" in between:
        scenario.may_kill(WALK)
    if "suspend walk" in between:
        scenario.may_suspend(WALK)
    return scenario


def messages_with(
    world: tca.World, message: Message[Any, Any], *states: str, data: Any = None
) -> list[tca.Seen]:
    """Return the messages with this name and data, and with all these attributes: "is_over",
    "is_killed", ...
    """
    return [
        one
        for one in world.messages
        if one.message == message.name
        and data in (None, one.data)
        and all(getattr(one, state) for state in states)
    ]


def has_ended(
    message: Message[Any, Any], data: Any = None
) -> Callable[[tca.World], list[tca.Seen]]:
    """Return a function for the tasks that have just ended, achieved or killed."""
    return lambda world: messages_with(world, message, "is_over", data=data)


def kept_at_once(call: str, kept: Callable[[tca.World], object]) -> tca.Property:
    """Return a property: an accepted call has its effect as soon as it is accepted."""

    def accepted_and_not_done(world: tca.World) -> bool:
        return bool(accepted(call)(world)) and not kept(world)

    return never(accepted_and_not_done)


def assert_holds(scenario: tca.Scenario, *properties: tca.Property) -> None:
    """Assert that the properties hold and are not vacuous, and that no task is stuck."""
    assert not assert_good(scenario, *properties, never_stuck(), limit=3000).vacuous
