"""What central promises, in every order in which things can happen; and that broken rules are found."""

from typing import Any

import pytest
from explorer.recoveries import HIGHER, helped
from explorer.scenarios import LIFT, NOTE, REST, STEP, WALK, WHERE, walking

from tca_explorer import (
    Scenario,
    Script,
    Task,
    achieved,
    at_most,
    before,
    begun,
    eventually,
    explore,
    handled_by,
    killed,
    never,
    never_stuck,
    planned,
    report,
)
from tca_wire.constraints import Constraint
from tca_wire.points import THIS, Moment, Point

IN_ORDER = before(achieved(STEP, 0), begun(STEP, 1))
REST_LAST = before(achieved(WALK), achieved(REST))


# --- nothing starts before its constraints ---------------------------------------------------------------------------


def test_nothing_starts_before_its_constraints() -> None:
    result = explore(walking(IN_ORDER, REST_LAST, never_stuck(), steps=3, capacity=2))
    assert result.ok, report(result)


def test_what_has_no_constraint_may_come_first() -> None:
    result = explore(walking(before(achieved(STEP, 1), begun(STEP, 2)), steps=3, capacity=2))
    assert result.violation is not None


def constrained(*properties: Any) -> Scenario:
    """Each flag, and a constraint between any two points, once."""
    scenario = Scenario("constrained", *properties)
    planner = scenario.module("planner", capacity=2)

    @planner.handles(WALK)
    def walk(task: Task) -> None:
        first = task.goal(REST, 1)
        task.goal(REST, 2, sequential_planning=True)
        task.goal(REST, 3, delay_planning=True)
        point = Point(first.id, Moment.END_HANDLING)
        task.command(LIFT, sequential=False, constraints=[Constraint(point, Point(THIS, Moment.START_ACHIEVING))])

    @planner.handles(REST)
    def rest(task: Task, number: int) -> None:
        if number < 3:
            task.command(STEP, number)

    @scenario.module("legs").handles(STEP)
    @scenario.module("arm").handles(LIFT)
    def act(_: Task) -> None: ...

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK).wait()

    return scenario


def test_every_flag_holds() -> None:
    result = explore(
        constrained(
            before(planned(REST, 1), begun(REST, 2)),
            before(achieved(REST, 2), begun(REST, 3)),
            before(achieved(STEP, 1), begun(STEP, 2)),
            never_stuck(),
        ),
        limit=3000,
    )
    assert result.ok, report(result)


def test_what_is_planned_first_is_planned_first() -> None:
    scenario = Scenario("planned first", before(planned(WALK), begun(STEP)), never_stuck())
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: Task) -> None:
        task.command(STEP)
        task.command(STEP)

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK, plan_first=True).wait()

    result = explore(scenario)
    assert result.ok, report(result)


# --- resources -------------------------------------------------------------------------------------------------------


def crowd(*properties: Any, capacity: int = 2, notes: bool = True, **legs: Any) -> Scenario:
    """Three (without *notes* two) who do not know each other want the legs at the same time."""
    scenario = Scenario("a crowd", *properties)
    feet = scenario.module("legs", capacity=capacity, **legs)

    @feet.handles(STEP)
    @feet.handles(WHERE)
    @feet.handles(NOTE)
    def act(task: Task) -> int | None:
        return 7 if task.message == WHERE.name else None

    @scenario.module("first").does
    def steps(me: Script) -> None:
        me.command(STEP)
        me.command(STEP, sequential=False, priority=1).wait()

    @scenario.module("second").does
    def asks(me: Script) -> None:
        assert me.query(WHERE) == 7

    if notes:

        @scenario.module("third").does
        def tells(me: Script) -> None:
            me.inform(NOTE)
            me.inform(NOTE)

    return scenario


@pytest.mark.parametrize("notes", [False, pytest.param(True, marks=pytest.mark.soak)])
@pytest.mark.parametrize("capacity", [1, 2])
def test_a_resource_is_never_over_capacity(capacity: int, notes: bool) -> None:
    scenario = crowd(at_most(capacity, handled_by("legs")), never_stuck(), capacity=capacity, notes=notes)
    result = explore(scenario)
    assert result.ok, report(result)


def test_a_resource_is_used_to_its_capacity() -> None:
    assert explore(crowd(at_most(1, handled_by("legs")), notes=False)).violation is not None


@pytest.mark.parametrize("notes", [False, pytest.param(True, marks=pytest.mark.soak)])
def test_nor_when_slots_come_and_go(notes: bool) -> None:
    scenario = crowd(at_most(1, handled_by("legs")), capacity=1, notes=notes, may_leave=True, arrives_late=True)
    result = explore(scenario, limit=5000)
    assert result.ok, report(result)


# --- kills and losses ------------------------------------------------------------------------------------------------


def test_a_killed_subtree_releases_its_waiters() -> None:
    scenario = walking(eventually(achieved(REST)), never_stuck(), before(killed(WALK), never_true))
    scenario.may_kill(WALK)
    result = explore(scenario)
    assert result.ok, report(result)
    assert explore(scenario, never(killed(STEP))).violation is not None  # it is killed with what is under it


def never_true(_: object) -> bool:
    return False


def test_a_failed_step_ends_the_walk_and_releases_its_waiters() -> None:
    result = explore(walking(eventually(achieved(REST)), never_stuck(), slips=True))
    assert result.ok, report(result)
    assert explore(walking(eventually(achieved(WALK)), slips=True)).violation is not None


def test_a_lost_module_releases_those_who_wait() -> None:
    result = explore(walking(eventually(achieved(REST)), never_stuck(), steps=1, may_be_lost=1, comes_back=True))
    assert result.ok, report(result)


def test_without_its_legs_it_waits() -> None:
    result = explore(walking(never_stuck(), may_be_lost=1))
    assert result.violation is not None
    assert "queued" in result.violation.why


# --- who waits for an exception handler is helped by somebody ---------------------------------------------------------

ALL_ENDS = (never_stuck(), never(killed(STEP)), eventually(achieved(STEP)))


@pytest.mark.parametrize("may_leave", [False, pytest.param(True, marks=pytest.mark.soak)])
def test_an_exception_handler_that_waits_when_its_module_goes_is_passed_over(may_leave: bool) -> None:
    result = explore(helped(*ALL_ENDS, may_leave=may_leave))
    assert result.ok, report(result)
    assert not explore(helped(never(killed(HIGHER)), may_leave=may_leave)).ok


def test_an_exception_handler_that_is_not_passed_over_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tca_central.failing.failures.pass_over", lambda _central, _handler: None)
    result = explore(helped(*ALL_ENDS))
    assert result.violation is not None
    assert "nobody handles 'higher', and the search does not go on" in result.violation.why
