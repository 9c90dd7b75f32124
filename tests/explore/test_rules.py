"""Promises of central hold in every order of events, and broken rules are found."""

from typing import Any

import pytest
from explore.scenarios import (
    HIGHER,
    NOTE,
    REST,
    STEP,
    WALK,
    WHERE,
    assert_good,
    counterexample,
    helped,
    walking,
)

import tca_tools.explore as tca
from tca_central.model.resources import Resource
from tca_tools.explore import (
    achieved,
    at_most,
    before,
    begun,
    eventually,
    failed,
    handled_by,
    killed,
    never,
    never_stuck,
    planned,
    resolved,
)
from tca_wire.messages.declarations import Command

IN_ORDER = before(achieved(STEP, 0), begun(STEP, 1))
REST_LAST = before(achieved(WALK), achieved(REST))


# --- nothing starts before its constraints --------------------------------------------------------


def test_no_task_starts_before_its_constraints() -> None:
    assert_good(walking(IN_ORDER, REST_LAST, never_stuck(), steps=3, capacity=2))


def test_unconstrained_step_may_start_first() -> None:
    counterexample(walking(before(achieved(STEP, 1), begun(STEP, 2)), steps=3, capacity=2))


def constrained(*properties: Any) -> tca.Scenario:
    """Return a scenario with each constraint flag once."""
    scenario = tca.Scenario("constrained", *properties)
    planner = scenario.module("planner", capacity=2)

    @planner.handles(WALK)
    def walk(task: tca.Task) -> None:
        task.goal(REST, 1)
        task.goal(REST, 2, sequential_planning=True)
        task.goal(REST, 3, delay_planning=True)

    @planner.handles(REST)
    def rest(task: tca.Task, number: int) -> None:
        if number < 3:
            task.command(STEP, number)

    @scenario.module("legs").handles(STEP)
    def act(_: tca.Task) -> None: ...

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.goal(WALK).wait()

    return scenario


def test_every_constraint_flag_holds() -> None:
    assert_good(
        constrained(
            before(planned(REST, 1), begun(REST, 2)),
            before(achieved(REST, 2), begun(REST, 3)),
            before(achieved(STEP, 1), begun(STEP, 2)),
            never_stuck(),
        ),
        limit=3000,
    )


def test_plan_first_goal_is_planned_before_its_steps() -> None:
    scenario = tca.Scenario("planned first", before(planned(WALK), begun(STEP)), never_stuck())
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        task.command(STEP)
        task.command(STEP)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.goal(WALK, plan_first=True).wait()

    assert_good(scenario)


# --- resources ------------------------------------------------------------------------------------


def crowd(*properties: Any, capacity: int = 2, notes: bool = True, **legs: Any) -> tca.Scenario:
    """Return a scenario: three independent users (two without *notes*) use the legs at the same
    time.
    """
    scenario = tca.Scenario("a crowd", *properties)
    feet = scenario.module("legs", capacity=capacity, **legs)

    @feet.handles(STEP)
    @feet.handles(WHERE)
    @feet.handles(NOTE)
    def act(task: tca.Task) -> int | None:
        return 7 if task.message == WHERE.name else None

    @scenario.module("first").does
    def steps(me: tca.Script) -> None:
        me.command(STEP)
        me.command(STEP, sequential=False, priority=1).wait()

    @scenario.module("second").does
    def asks(me: tca.Script) -> None:
        assert me.query(WHERE) == 7

    if notes:

        @scenario.module("third").does
        def tells(me: tca.Script) -> None:
            me.inform(NOTE)
            me.inform(NOTE)

    return scenario


@pytest.mark.parametrize("notes", [False, pytest.param(True, marks=pytest.mark.soak)])
@pytest.mark.parametrize("capacity", [1, 2])
def test_resource_stays_within_capacity(capacity: int, notes: bool) -> None:
    scenario = crowd(
        at_most(capacity, handled_by("legs")), never_stuck(), capacity=capacity, notes=notes
    )
    assert_good(scenario)


def test_resource_is_used_to_its_capacity() -> None:
    counterexample(crowd(at_most(1, handled_by("legs")), notes=False))


@pytest.mark.soak
@pytest.mark.parametrize("late_too", [False, pytest.param(True, marks=pytest.mark.soak)])
def test_resource_stays_within_capacity_when_slots_change(late_too: bool) -> None:
    legs = {"capacity": 1, "may_leave": True, "arrives_late": late_too}
    scenario = crowd(at_most(1, handled_by("legs")), notes=late_too, **legs)
    assert_good(scenario, limit=5000)


# --- kills and losses -----------------------------------------------------------------------------


def test_killed_subtree_releases_its_waiters() -> None:
    scenario = walking(eventually(achieved(REST)), never_stuck(), before(killed(WALK), never_true))
    scenario.may_kill(WALK)
    assert_good(scenario)
    counterexample(scenario, never(killed(STEP)))


def never_true(_: object) -> bool:
    return False


def test_failed_step_ends_its_goal_and_releases_waiters() -> None:
    assert_good(walking(eventually(achieved(REST)), never_stuck(), slips=True))
    counterexample(walking(eventually(achieved(WALK)), slips=True))


@pytest.mark.soak
def test_lost_module_releases_waiters() -> None:
    assert_good(
        walking(eventually(achieved(REST)), never_stuck(), steps=1, may_be_lost=1, comes_back=True)
    )


def test_step_stays_queued_without_its_module() -> None:
    assert "queued" in counterexample(walking(never_stuck(), steps=1, may_be_lost=1))


# --- exception handlers of departed modules -----------------------------------------------------

ALL_ENDS = (never_stuck(), never(killed(STEP)), eventually(resolved(STEP)))


@pytest.mark.soak
@pytest.mark.parametrize("may_leave", [False, pytest.param(True, marks=pytest.mark.soak)])
def test_exception_handler_of_departed_module_is_skipped(
    may_leave: bool,
) -> None:
    assert_good(helped(*ALL_ENDS, may_leave=may_leave))
    counterexample(helped(never(killed(HIGHER)), may_leave=may_leave))


def test_unskipped_exception_handler_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "tca_central.failing.failures.skip_exception_handler", lambda _central, _handler: None
    )
    assert "no handler of 'higher', and the search does not continue" in counterexample(
        helped(*ALL_ENDS)
    )


# --- locks and reservations -----------------------------------------------------------------------

GRIP = Command("grip")


def two_arms(first: str, second: str, *properties: tca.Property) -> tca.Scenario:
    """Return a scenario with two handlers that each lock two resources. One handler locks the legs,
    then the arm. The other locks *first*, then *second*.
    """
    scenario = tca.Scenario("two arms", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("arm").handles(GRIP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        with task.lock("legs"), task.lock("arm"):
            pass

    @scenario.module("rester").handles(REST)
    def rest(task: tca.Task) -> None:
        with task.lock(first), task.lock(second):
            pass

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.goal(WALK, "there")
        me.goal(REST, sequential=False)

    return scenario


def one_holds_both(world: tca.World) -> bool:
    return len(world.held_by) == 2 and len({claim.sender for claim in world.held_by.values()}) == 1


def test_locks_in_opposite_order_may_deadlock() -> None:
    result = tca.explore(two_arms("arm", "legs", never_stuck()))
    assert result.violation is not None
    text = tca.report(result)
    assert "planner in walk {1} waits to lock arm" in text
    assert "rester in rest {3} waits to lock legs" in text


def test_locks_in_one_order_never_deadlock() -> None:
    assert_good(two_arms("legs", "arm", never_stuck()))


def test_property_sees_lock_holders() -> None:
    counterexample(two_arms("legs", "arm", never(one_holds_both)))


def reserved() -> tca.Result:
    """Explore a scenario: the planner reserves the legs for its own steps during its walk. No step
    of the user may start in between.
    """
    scenario = tca.Scenario("reserved", never_stuck())
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        task.reserve("legs")
        task.command(STEP, "one")
        task.command(STEP, "two")

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.goal(WALK, "there")
        me.command(STEP, "other", sequential=False)

    return tca.explore(scenario)


def test_reservation_lasts_as_long_as_its_task() -> None:
    assert reserved().ok


def test_central_that_ignores_reservation_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Resource, "admits", lambda _self, _message: True)
    result = reserved()
    assert result.violation is not None
    assert "step {3} was given to legs, which planner has reserved" in tca.report(result)


def test_lock_of_module_that_may_be_lost_is_valid() -> None:
    """The lock of a lost module is not an error of the scenario."""
    scenario = tca.Scenario("a lost base", never_stuck())
    scenario.module("legs", may_be_lost=1).handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        with task.lock("legs"):
            pass

    scenario.module("user").does(lambda me: [me.goal(WALK, "there")])
    assert_good(scenario)


def test_property_that_raises_is_scenario_error() -> None:
    with pytest.raises(tca.ScenarioError, match="can't be asked: AttributeError"):
        tca.explore(two_arms("legs", "arm", never(lambda world: world.taks)))


def unlocked(*properties: tca.Property) -> tca.Result:
    """Explore a scenario: an operator unlocks the legs, with or without a lock of the planner."""
    scenario = tca.Scenario("an operator unlocks", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        with task.lock("legs"):
            pass

    scenario.module("user").does(lambda me: [me.goal(WALK, "there")])
    scenario.module("operator").does(lambda me: [me.unlock("legs")])
    return tca.explore(scenario)


def test_handler_fails_when_its_lock_is_taken_away() -> None:
    result = unlocked(never(failed(WALK)))
    assert result.violation is not None
    assert "lock lost" in tca.report(result)


def test_handler_ends_when_its_lock_is_taken_away() -> None:
    assert unlocked(never_stuck()).ok
