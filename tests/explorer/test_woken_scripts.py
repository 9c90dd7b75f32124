"""Whoever is killed while it asks ends at once, whatever it waits for; and it is woken once, as on the robot."""

from collections.abc import Callable
from typing import Any

import pytest
from explorer.accepting import those
from explorer.scenarios import HEIGHTS, LIFT, NOTE, REST, STEP, WALK, WHERE

from tca_explorer import Scenario, Task, World, begun, explore, failed, never, report, within
from tca_module import Stopped, TaskKilled

HELD = "arm"

WAITS: dict[str, Callable[[Task], Any]] = {
    "query": lambda task: task.query(WHERE),
    "multi-query": lambda task: task.multi_query(HEIGHTS),
    "receive": lambda task: task.query_send(WHERE).receive(),
    "a stranger's task": lambda task: [step.wait() for step in task.tasks(STEP)],
    "subtask": lambda task: task.command(STEP).wait(),
    "result": lambda task: task.command(STEP).result(),
    "lock": lambda task: task.lock(HELD),
    "until handled": lambda task: task.wait_until_handled(LIFT),
}


def some(*names: str) -> list[Any]:
    return [pytest.param(how, marks=[] if how in names else [pytest.mark.soak]) for how in WAITS]


def killed(world: World) -> object:
    return those(world, WALK, "is_killed")


def returned(world: World) -> object:
    """What it waits for may go on for ever, and if that is under it, it ends no sooner."""
    return [walk for walk in those(world, WALK, "is_killed") if not walk.is_handled]


def asking(handler: Callable[[Task], Any], *properties: Any, **planner: Any) -> Scenario:
    """A walk that asks, and may be killed; nobody answers it, ends what it waits for or frees the arm."""
    scenario = Scenario("asking", *properties)
    scenario.module("planner", **planner).handles(WALK)(handler)
    others = scenario.module("others", capacity=3)
    for message in (WHERE, HEIGHTS, STEP):
        others.handles(message)(lambda task: task.hang())
    scenario.module("arm").handles(REST)(lambda _: None)
    scenario.module("notes").handles(NOTE)(lambda _: None)
    scenario.module("boats", arrives_late=True).handles(LIFT)(lambda _: None)

    @scenario.module("user").does
    def story(me: Any) -> None:
        me.lock(HELD)
        me.command(STEP, sequential=False)
        me.goal(WALK, sequential=False)

    if not planner:
        scenario.may_kill(WALK)
    return scenario


@pytest.mark.parametrize("how", some("query", "a stranger's task", "result", "lock", "until handled"))
def test_whoever_is_killed_while_it_asks_ends_at_once(how: str) -> None:
    scenario = asking(WAITS[how], within(0, killed, returned), never(failed(WALK)))
    result = explore(scenario, limit=20_000)
    assert result.ok, report(result)


@pytest.mark.parametrize("how", some("query", "lock"))
def test_who_was_woken_may_ask_further(how: str) -> None:
    def cleans_up(task: Task) -> None:
        try:
            WAITS[how](task)
        except TaskKilled:
            assert task.cancelled
            task.wait_until_handled(NOTE)
            task.inform(NOTE)
            raise

    result = explore(asking(cleans_up, never(begun(NOTE))), limit=20_000)
    assert result.violation is not None
    assert "somebody kills walk" in report(result)


def test_who_has_read_that_it_is_killed_is_not_woken() -> None:
    def waits_on(task: Task) -> None:
        if task.cancelled:
            task.query(WHERE)

    result = explore(asking(waits_on, within(0, killed, returned)), limit=20_000)
    assert not result.ok
    assert "waits for the answer to query where" in report(result)


# --- its module ends --------------------------------------------------------------------------------------------------


def lost(world: World) -> object:
    return [walk for walk in those(world, WALK, "failure") if walk.failure == "module lost"]


def gone(world: World) -> bool:
    return "planner" not in world.modules


@pytest.mark.parametrize("how", some("lock"))
def test_whoever_asks_when_its_module_leaves_is_woken(how: str) -> None:
    """With Stopped, as on the robot: the walk fails, and the module can go."""
    seen = set()

    def asks(task: Task) -> None:
        try:
            WAITS[how](task)
        except Stopped:
            seen.add(task.cancelled)
            task.wait_until_handled(NOTE)
            raise

    result = explore(asking(asks, may_leave=True), limit=20_000)
    assert result.ok, report(result)
    assert seen == {True}
    for never_comes in (lost, gone):
        assert explore(asking(asks, never(never_comes), may_leave=True), limit=20_000).violation is not None


def test_who_knows_that_its_module_ends_and_returns_may_have_done_half_of_it() -> None:
    def returns(task: Task) -> None:
        if task.cancelled:
            return
        try:
            task.query(WHERE)
        except Stopped:
            return

    result = explore(asking(returns, never(lost), may_leave=True), limit=20_000)
    assert result.violation is not None
