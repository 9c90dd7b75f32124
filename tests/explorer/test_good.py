"""\"Good\" holds for every run, whatever properties look at; and a property that says nothing is named."""

from typing import Any

import pytest
from explorer.scenarios import LIFT, NOTE, REST, STEP, WALK, WHERE, walking

from tca_explorer import (
    Property,
    Scenario,
    ScenarioError,
    Script,
    Seen,
    Task,
    World,
    achieved,
    at_most,
    before,
    begun,
    eventually,
    explore,
    handled,
    killed,
    never,
    never_stuck,
    report,
    sent,
    within,
)
from tca_explorer.observed.fold import Fold
from tca_module import PollingMonitor, Query, this

IS_LOW: Query[None, bool] = Query("is low", reply=bool)
GAUGE = PollingMonitor("gauge", condition=IS_LOW)


# --- time ------------------------------------------------------------------------------------------------------------


def tea(*properties: Property, order: tuple[str, str] = ("fast", "slow")) -> Scenario:
    """Heating takes 1 s or 3 s, pouring begins 3 s after that."""
    scenario = Scenario("tea", *properties)
    scenario.module("kettle", capacity=2).handles(STEP)(lambda _: None)

    @scenario.module("maid").handles(WALK)
    def make(task: Task) -> None:
        heat = task.goal(REST)
        task.command(STEP, "pour", constraints=[heat.achieving.end + 3.0 <= this.achieving.start])

    @scenario.module("stove").handles(REST)
    def heat(task: Task) -> None:
        task.command(STEP, "heat", delay=1.0 if task.choose(*order) == "fast" else 3.0)

    scenario.module("user").does(lambda me: [me.goal(WALK)])
    return scenario


def is_late(world: World) -> list[Seen]:
    return [task for task in world.tasks if world.now > 5 and task.message == STEP.name and task.data == "pour"]


@pytest.mark.parametrize("order", [("fast", "slow"), ("slow", "fast")])
def test_what_looks_at_the_time_is_judged_at_each_time(order: tuple[str, str]) -> None:
    """The same state is reached after 4 s and after 6 s, and whichever comes first is not the one that counts."""
    result = explore(tea(never(is_late), order=order))
    assert result.violation is not None, report(result)
    assert "3 s pass" in report(result)


def polled(*properties: Property) -> Scenario:
    """A battery is looked at every second, for ever."""
    scenario = Scenario("polled", *properties)
    scenario.module("battery").handles(IS_LOW)(lambda _: False)
    scenario.module("user").does(lambda me: [me.monitor(GAUGE, period=1.0, for_ever=True)])
    return scenario


def test_a_time_that_comes_after_all_states_were_seen_once_comes_all_the_same() -> None:
    assert explore(polled(never_stuck())).ok
    assert not explore(polled(never(lambda world: world.now > 5))).ok


def test_what_looks_at_the_time_of_what_never_ends_is_not_known() -> None:
    result = explore(polled(never(lambda world: world.now < 0)), limit=50)
    assert "not known" in report(result)


@pytest.mark.parametrize("order", [("fast", "slow"), ("slow", "fast")])
@pytest.mark.parametrize(("seconds", "ok"), [(6.0, True), (5.9, False), (6, True)])
def test_something_happens_within_so_many_seconds_of_something_else(
    order: tuple[str, str], seconds: float, *, ok: bool
) -> None:
    result = explore(tea(within(seconds, sent(WALK), begun(STEP, "pour")), order=order))
    assert result.ok is ok, report(result)


def test_within_says_how_much_time_has_passed() -> None:
    text = report(explore(tea(within(4.5, sent(WALK), begun(STEP, "pour")))))
    assert "tea: NOT step begun with data='pour' within 4.5 s of walk sent" in text
    assert "=> here 6 s have passed" in text


def test_what_is_late_is_late_when_it_comes_with_the_same_action() -> None:
    """The pouring starts at 3 s + 3 s, with the passing of time itself."""
    assert explore(tea(within(3.0, achieved(STEP, "heat"), begun(STEP, "pour")))).ok
    assert not explore(tea(within(2.0, achieved(STEP, "heat"), begun(STEP, "pour")))).ok


def test_within_is_owed_at_the_end_of_a_run() -> None:
    result = explore(walking(within(5.0, achieved(WALK), killed(REST))))
    assert "nothing further need happen, and it never did" in report(result)


def test_within_does_not_make_a_scenario_endless() -> None:
    result = explore(polled(within(1.0, sent(IS_LOW), handled(IS_LOW))))
    assert result.ok, report(result)
    assert not explore(polled(within(1.0, sent(IS_LOW), handled(NOTE)))).ok
    assert not explore(polled(within(1.0, lambda world: not world.passed, lambda world: world.passed > 1))).ok


# --- names -----------------------------------------------------------------------------------------------------------


def first_id(world: World) -> object:
    return next(iter(world.messages)).id if len(world.messages) else None


@pytest.mark.parametrize(
    "looks",
    [
        lambda world: [seen for seen in world.messages if seen.id > 40],
        lambda world: [seen for seen in world.messages if seen.parent_id == 0],
        lambda world: [int(seen.about) for seen in world.messages],
        lambda world: [f"{seen.id:03}" for seen in world.messages],
        lambda world: [seen for seen in world.messages if seen.id and not seen.id],
        lambda world: len(sorted(seen.id for seen in world.messages)) > 9,
        lambda world: sum(seen.id for seen in world.messages),
    ],
)
def test_an_id_is_only_a_name(looks: Any) -> None:
    with pytest.raises(ScenarioError, match="an id is another number in each run: it can be compared with other ids"):
        explore(walking(never(looks)))


def test_the_age_of_messages_can_not_be_told() -> None:
    with pytest.raises(ScenarioError, match="messages have no order here: choose by what they are"):
        explore(walking(never(lambda world: world.tasks[0])))


def test_names_say_nothing_in_other_ways_either() -> None:
    """Neither as text, nor by the order of a set."""
    texts: set[str] = set()

    def looks(world: World) -> bool:
        texts.update(f"{seen} {seen.id!r}" for seen in world.messages)
        assert len({seen.id for seen in world.messages}) == len(world.messages)
        return len({hash(seen.id) for seen in world.messages}) > 1

    assert explore(walking(never(looks))).ok
    assert texts == {"walk an id", "rest an id", "step an id"}


def test_relatives_are_found() -> None:
    def is_orphan(world: World) -> list[Seen]:
        return [task for task in world.tasks if task.message == STEP.name
                and (parent := world.parent(task)) is not None
                and (task not in world.children(parent) or parent.message != WALK.name)]  # fmt: skip

    assert explore(walking(never(is_orphan))).ok
    assert not explore(walking(never(lambda world: any(world.parent(one) for one in world.tasks)))).ok


def test_what_holds_a_task_is_seen() -> None:
    def waits_for_the_first(world: World) -> bool:
        return any(leader is not None and leader.data == 0 for task in world.tasks if task.data == 1
                   for _, _, leader in world.held(task))  # fmt: skip

    assert not explore(walking(never(waits_for_the_first))).ok


def test_who_is_there_is_seen() -> None:
    result = explore(walking(never(lambda world: "legs" not in world.modules), may_be_lost=1))
    assert result.violation is not None
    assert explore(walking(never(lambda world: world.modules != ("legs", "planner", "user")))).ok


# --- what says nothing -----------------------------------------------------------------------------------------------


def test_a_property_that_is_about_nothing_is_named() -> None:
    scenario = walking(before(achieved(WALK), begun(LIFT)), at_most(1, handled(LIFT)),
                             within(1.0, sent(LIFT), achieved(LIFT)), before(achieved(WALK), achieved(REST)))  # fmt: skip
    scenario.module("arm").handles(LIFT)(lambda _: None)
    result = explore(scenario)
    assert result.ok
    assert report(result).splitlines()[1:] == [
        "  said nothing: 'walk achieved before lift begun': there never is 'lift begun'",
        "  said nothing: 'at most 1 lift handled': there never is 'lift handled'",
        "  said nothing: 'lift achieved within 1 s of lift sent': there never is 'lift sent'",
    ]


def test_a_property_that_is_met_at_once_is_about_something() -> None:
    """Also where what comes second comes only after what must come first."""
    assert not explore(walking(before(begun(WALK), achieved(REST)), at_most(3, begun(STEP)))).vacuous


# --- runs that go on for ever ----------------------------------------------------------------------------------------


def beside_a_clock(walk: Any, *properties: Property) -> Scenario:
    """A battery is looked at every second for ever; and somebody walks."""
    scenario = polled(*properties)
    scenario.module("planner").handles(WALK)(walk)
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("walker").does
    def story(me: Script) -> None:
        me.goal(WALK)

    return scenario


def steps(task: Task) -> None:
    task.command(STEP)


def test_what_never_happens_beside_an_endless_activity_is_found() -> None:
    result = explore(beside_a_clock(lambda task: task.hang(), eventually(achieved(WALK))))
    assert result.violation is not None
    assert result.violation.circle
    text = report(result)
    assert "polled: NOT eventually walk achieved" in text
    assert "and then again and again:\n" in text
    assert "1 s pass" in text.partition("again and again")[2]
    assert text.endswith("=> this can go on for ever, and it never happens")


def test_who_waits_for_ever_beside_an_endless_activity_is_found() -> None:
    text = report(explore(beside_a_clock(lambda task: task.hang(), never_stuck())))
    assert "this can go on for ever, and all the while:\n     planner in walk {" in text
    assert "never goes on" in text


def test_what_happens_some_time_beside_an_endless_activity_is_good() -> None:
    """That a script which can go on never does, or that time stands still, is no run."""
    result = explore(beside_a_clock(steps, eventually(achieved(WALK)), never_stuck()))
    assert result.ok, report(result)
    assert result.longest is None


@pytest.mark.soak
def test_a_task_that_nobody_takes_is_found_beside_an_endless_activity() -> None:
    scenario = beside_a_clock(steps, never_stuck())
    scenario.modules["legs"].may_be_lost = 1
    text = report(explore(scenario))
    assert "step {" in text
    assert "queued" in text


def ping(note: Any, *properties: Property) -> Scenario:
    """A note that its handler may send again; and one who walks, on the same legs."""
    scenario = Scenario("ping", *properties)
    legs = scenario.module("legs")
    legs.handles(NOTE)(note)
    legs.handles(STEP)(lambda _: None)
    scenario.module("pinger").does(lambda me: me.inform(NOTE))
    scenario.module("walker").does(lambda me: [me.command(STEP)])
    return scenario


def again(task: Task) -> None:
    task.inform(NOTE)


def again_or_not(task: Task) -> None:
    if task.choose("again", "enough") == "again":
        task.inform(NOTE)


def test_what_is_queued_comes_to_its_turn() -> None:
    result = explore(ping(again, never_stuck(), eventually(achieved(STEP))))
    assert result.ok, report(result)
    assert result.longest is None


def starving(priority: int, *properties: Property) -> Scenario:
    """The legs are asked by two in turn, again and again, and each question may go before a step."""
    scenario = Scenario("starving", *properties)
    legs, ear = scenario.module("legs"), scenario.module("ear")
    legs.handles(STEP)(lambda _: None)

    @legs.handles(WHERE)
    def where(task: Task) -> int:
        task.inform(NOTE)
        return 7

    @ear.handles(NOTE)
    def note(task: Task) -> None:
        task.query_send(WHERE, priority=priority)

    scenario.module("pinger").does(lambda me: [me.inform(NOTE), me.inform(NOTE)])
    scenario.module("walker").does(lambda me: [me.command(STEP)])
    return scenario


def test_no_slot_is_left_standing() -> None:
    """The battery is looked at in whichever slot the step is not: that the other slot goes on is no excuse."""
    scenario = Scenario("two slots", never_stuck(), eventually(achieved(STEP)))
    legs = scenario.module("legs", capacity=2)
    legs.handles(IS_LOW)(lambda _: False)
    legs.handles(STEP)(lambda _: None)
    scenario.module("user").does(lambda me: [me.monitor(GAUGE, period=1.0, for_ever=True)])
    scenario.module("walker").does(lambda me: [me.command(STEP)])
    result = explore(scenario)
    assert result.ok, report(result)


@pytest.mark.soak
def test_what_never_comes_to_its_turn_is_found() -> None:
    """Each of the others has its turn all the time, so it is no accident. Where nobody goes first, all have theirs."""
    result = explore(starving(1, never_stuck()))
    assert result.violation is not None, report(result)
    assert "all the while:\n     step {" in report(result)
    assert "queued" in report(result)
    assert {action.name for action in result.violation.circle} >= {"legs/1", "ear/1"}
    assert explore(starving(0, never_stuck(), eventually(achieved(STEP)))).ok
    assert not explore(starving(1, eventually(achieved(STEP)))).ok


def test_who_may_decide_the_same_for_ever_does() -> None:
    """No choice need ever be made."""
    only_again = ping(again_or_not, eventually(lambda world: not world.messages and world.modules == ()))
    assert "nothing further need happen" in report(explore(only_again))
    result = explore(ping(again_or_not, eventually(over)))
    assert result.violation is not None
    assert "chooses again" in report(result).partition("again and again:")[2]
    assert explore(ping(again_or_not, never_stuck())).ok


def over(world: World) -> list[Seen]:
    """The last note has been handled, and sent no other."""
    notes = [seen for seen in world.messages if seen.message == NOTE.name]
    return [seen for seen in notes if seen.is_over and len(notes) == 1]


def test_a_fold_needs_no_central() -> None:
    assert list(World(Fold(), {}).messages) == []


# --- what is counted -------------------------------------------------------------------------------------------------


def test_what_has_ended_makes_room_for_what_begins_with_the_same_action() -> None:
    """As in ``tca check``, with the same words: legs with one slot have begun one step at a time."""
    one_at_a_time = at_most(1, begun(STEP)), at_most(1, handled(STEP))
    assert explore(walking(*one_at_a_time, steps=3)).ok
    assert not explore(walking(at_most(0, begun(STEP)))).ok
    assert not explore(walking(at_most(0, achieved(STEP)))).ok
