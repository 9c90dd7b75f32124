"""Locks and reservations in scenarios: what is kept out, and who waits for ever."""

import pytest
from explorer.scenarios import REST, STEP, WALK

from tca_central.model.resources import Resource
from tca_explorer import (
    Property,
    Result,
    Scenario,
    ScenarioError,
    Script,
    Task,
    World,
    explore,
    failed,
    never,
    never_stuck,
    report,
)
from tca_wire.messages.declarations import Command

GRIP = Command("grip")


def two_arms(first: str, second: str, *properties: Property) -> Scenario:
    """Two handlers that each need both of two resources; one locks *first* first, the other *second*."""
    scenario = Scenario("two arms", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("arm").handles(GRIP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: Task) -> None:
        with task.lock("legs"), task.lock("arm"):
            pass

    @scenario.module("rester").handles(REST)
    def rest(task: Task) -> None:
        with task.lock(first), task.lock(second):
            pass

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK, "there")
        me.goal(REST, sequential=False)

    return scenario


def both(world: World) -> bool:
    return len(world.held_by) == 2 and len({claim.sender for claim in world.held_by.values()}) == 1


def test_who_locks_in_another_order_may_wait_for_ever() -> None:
    result = explore(two_arms("arm", "legs", never_stuck()))
    assert result.violation is not None
    text = report(result)
    assert "planner in walk {1} waits to lock arm" in text
    assert "rester in rest {3} waits to lock legs" in text


def test_who_locks_in_one_order_does_not() -> None:
    assert explore(two_arms("legs", "arm", never_stuck())).ok


def test_it_is_seen_who_has_what() -> None:
    assert not explore(two_arms("legs", "arm", never(both))).ok


def reserved() -> Result:
    """The planner reserves the legs for its own steps, as long as its walk takes: the promises say that none of the
    user's comes between."""
    scenario = Scenario("reserved", never_stuck())
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: Task) -> None:
        task.reserve("legs")
        task.command(STEP, "one")
        task.command(STEP, "two")

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK, "there")
        me.command(STEP, "other", sequential=False)

    return explore(scenario)


def test_a_reservation_lasts_as_long_as_its_task() -> None:
    assert reserved().ok


def test_a_central_that_lets_others_in_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Resource, "admits", lambda _self, _message: True)
    result = reserved()
    assert result.violation is not None
    assert "was given to 'legs' while planner has it reserved" in report(result)


def test_a_lock_of_a_module_that_may_be_lost() -> None:
    """That it is gone is no mistake of the scenario."""
    scenario = Scenario("a lost base", never_stuck())
    scenario.module("legs", may_be_lost=1).handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: Task) -> None:
        with task.lock("legs"):
            pass

    scenario.module("user").does(lambda me: [me.goal(WALK, "there")])
    assert explore(scenario).ok


def test_a_property_that_can_not_be_asked_is_a_mistake_in_the_scenario() -> None:
    with pytest.raises(ScenarioError, match="can't be asked: AttributeError"):
        explore(two_arms("legs", "arm", never(lambda world: world.taks)))


def unlocked(*properties: Property) -> Result:
    """An operator takes the legs from a planner, whether that has them just then or not."""
    scenario = Scenario("an operator unlocks", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: Task) -> None:
        with task.lock("legs"):
            pass

    scenario.module("user").does(lambda me: [me.goal(WALK, "there")])
    scenario.module("operator").does(lambda me: [me.unlock("legs")])
    return explore(scenario)


def test_a_handler_fails_that_has_lost_its_lock() -> None:
    result = unlocked(never(failed(WALK)))
    assert result.violation is not None
    assert "lock lost" in report(result)


def test_a_handler_that_has_lost_its_lock_comes_to_its_end() -> None:
    assert unlocked(never_stuck()).ok
