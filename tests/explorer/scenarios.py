"""Small scenarios that several tests explore."""

from typing import Any

from tca_explorer import Property, Scenario, Script, Task
from tca_wire.messages.declarations import Command, Failure, Goal, Inform, MultiQuery, Query

WALK: Goal[Any] = Goal("walk", Any)
REST: Goal[Any] = Goal("rest", Any)
STEP: Command[Any, Any] = Command("step", Any, result=Any)
LIFT: Command[Any, Any] = Command("lift", Any)
WHERE: Query[Any, Any] = Query("where", reply=int)
HEIGHTS: MultiQuery[Any, Any] = MultiQuery("heights", reply=int)
NOTE: Inform[Any] = Inform("note", Any)
SLIPPED = Failure("slipped")


def walking(*properties: Property, steps: int = 2, slips: bool = False, **legs: Any) -> Scenario:
    """A user walks and then rests; a walk is steps, all but the first of which need not come in order."""
    scenario = Scenario("walking", *properties)
    planner, feet, user = scenario.module("planner"), scenario.module("legs", **legs), scenario.module("user")

    @planner.handles(WALK)
    def walk(task: Task) -> None:
        for number in range(steps):
            task.command(STEP, number, sequential=number == 1)

    @planner.handles(REST)
    def rest(_: Task) -> None: ...

    @feet.handles(STEP)
    def step(task: Task) -> None:
        if slips and task.choose("holds", "slips") == "slips":
            raise SLIPPED(text="ice")

    @user.does
    def story(me: Script) -> None:
        me.goal(WALK)
        me.goal(REST).wait()

    return scenario
