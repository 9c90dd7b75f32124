"""A robot of which one thing is asked, and all that may come in between before it is done."""

from collections.abc import Callable
from typing import Any

from explore.scenarios import LIFT, SLIPPED, STEP, WALK, good

import tca_tools.explore as tca
from tca_module import ExceptionHandler
from tca_module.sending.task_ref import TaskRef
from tca_tools.explore import accepted, never, never_stuck
from tca_wire.messages.declarations import Message

HELP: ExceptionHandler[None] = ExceptionHandler("help")

LOST: dict[str, Any] = {"may_be_lost": 1, "comes_back": True}

EVER = 1e6  # seconds: longer than all that comes by itself

LONG = 100.0  # seconds, where there are others to be in time

BETWEEN = {
    "loss of who handles it": "lose legs",
    "failure and retry": "slip, kill step",
    "kills": "kill step, kill walk",
    "loss of an outsider who asked": "lose operator",
    "suspension": "suspend walk, kill step",
    "loss of who asked": "lose planner",
}
"""What may come in between: any of it, at any moment. In this order the pairs that are not soaked
are cheap ones.
"""


def robot(title: str, ask: Callable[[Any, TaskRef], object], between: str = "") -> tca.Scenario:
    """A user's walk is one step, of which its planner then asks something; or an operator who finds
    that step.
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


def those(
    world: tca.World, message: Message[Any, Any], *states: str, data: Any = None
) -> list[tca.Seen]:
    """The messages of that name (and data) of which all of that is true: "is_over", "is_killed",
    ...
    """
    return [
        one
        for one in world.messages
        if one.message == message.name
        and data in (None, one.data)
        and all(getattr(one, state) for state in states)
    ]


def over(message: Message[Any, Any], data: Any = None) -> Callable[[tca.World], list[tca.Seen]]:
    """Those that have just ended, achieved or killed."""
    return lambda world: those(world, message, "is_over", data=data)


def at_once(call: str, kept: Callable[[tca.World], object]) -> tca.Property:
    """What is asked for by that call is true as soon as it has been accepted."""

    def accepted_and_not_done(world: tca.World) -> bool:
        return bool(accepted(call)(world)) and not kept(world)

    return never(accepted_and_not_done)


def holds(scenario: tca.Scenario, *properties: tca.Property) -> None:
    """That all of this is true, that it is about something, and that nobody is left waiting."""
    assert not good(scenario, *properties, never_stuck(), limit=3000).vacuous
