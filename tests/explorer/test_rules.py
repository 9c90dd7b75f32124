"""What central promises, in every order in which things can happen; and that broken rules are found."""

from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
from explorer.recoveries import HIGHER, helped
from explorer.scenarios import LIFT, NOTE, REST, STEP, WALK, WHERE, walking

from tca_central.model.deliveries import ModuleResource
from tca_central.model.task_tree import Task as LiveTask
from tca_central.order.agenda import Agenda
from tca_central.order.dispatcher import Dispatcher
from tca_central.order.holds import Holds
from tca_explorer import (
    Result,
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


@pytest.mark.parametrize("capacity", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_a_resource_is_never_over_capacity(capacity: int) -> None:
    result = explore(crowd(at_most(capacity, handled_by("legs")), never_stuck(), capacity=capacity))
    assert result.ok, report(result)


def test_a_resource_is_used_to_its_capacity() -> None:
    assert explore(crowd(at_most(1, handled_by("legs")))).violation is not None


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
    result = explore(walking(eventually(achieved(REST)), never_stuck(), may_be_lost=1, comes_back=True))
    assert result.ok, report(result)


def test_without_its_legs_it_waits() -> None:
    result = explore(walking(never_stuck(), may_be_lost=1))
    assert result.violation is not None
    assert "queued" in result.violation.why


# --- broken rules are found ------------------------------------------------------------------------------------------


def release_too_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """Followers are released by whatever their leader reaches."""
    real = Holds.release_followers
    monkeypatch.setattr(Holds, "release_followers", lambda self, task, _: real(self, task, 63))


def release_nobody_who_was_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    def release(self: Holds, task: LiveTask, moments: int, real: Any = Holds.release_followers) -> list[LiveTask]:
        released: list[LiveTask] = [] if task.killed else real(self, task, moments)
        return released

    monkeypatch.setattr(Holds, "release_followers", release)


def give_slots_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ModuleResource, "take_slot", lambda self: next(iter(self.slots), None))


def forget_freed_slots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Dispatcher, "offer_next", lambda self: self.to_offer.clear())


def achieve_before_the_children(monkeypatch: pytest.MonkeyPatch) -> None:
    real = Agenda._may_reach
    monkeypatch.setattr(
        Agenda, "_may_reach", lambda self, task, moment: moment == 32 or real(self, task, moment)
    )  # fmt: skip


def walk_and_kill() -> Result:
    scenario = walking(IN_ORDER, eventually(achieved(REST)), never_stuck())
    scenario.may_kill(WALK)
    return explore(scenario)


BROKEN: dict[Callable[[pytest.MonkeyPatch], None], Callable[[], Result]] = {
    release_too_early: walk_and_kill,
    release_nobody_who_was_killed: walk_and_kill,
    achieve_before_the_children: walk_and_kill,
    forget_freed_slots: walk_and_kill,
    give_slots_twice: lambda: explore(crowd(at_most(2, handled_by("legs")), notes=False)),
}


@cache
def is_good(explored: Callable[[], Result]) -> bool:
    """Before anything is broken. Where all is checked, it is good where less is."""
    return explored().ok


@pytest.mark.parametrize("mutation", BROKEN, ids=lambda mutation: mutation.__name__)
@pytest.mark.parametrize("checked", ["by everything", "by promises and properties"])
def test_a_broken_rule_is_found(
    monkeypatch: pytest.MonkeyPatch, mutation: Callable[[pytest.MonkeyPatch], None], checked: str
) -> None:
    assert is_good(BROKEN[mutation])
    if checked == "by promises and properties":
        monkeypatch.setattr("tca_explorer.search.exploration.check_invariants", lambda _: None)
    mutation(monkeypatch)
    result = BROKEN[mutation]()
    assert result.violation is not None, report(result)
    if checked == "by promises and properties":
        assert result.violation.broken != "central's own invariants"


# --- who waits for an exception handler is helped by somebody ---------------------------------------------------------

ALL_ENDS = (never_stuck(), never(killed(STEP)), eventually(achieved(STEP)))


def test_an_exception_handler_that_waits_when_its_module_goes_is_passed_over() -> None:
    result = explore(helped(*ALL_ENDS))
    assert result.ok, report(result)
    assert not explore(helped(never(killed(HIGHER)))).ok


def test_an_exception_handler_that_is_not_passed_over_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tca_central.failing.failures.pass_over", lambda _central, _handler: None)
    result = explore(helped(*ALL_ENDS))
    assert result.violation is not None
    assert "nobody handles 'higher', and the search does not go on" in result.violation.why
