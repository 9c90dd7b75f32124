"""The answer "good" holds for every run, whatever the properties inspect. Vacuous properties are
named.
"""

from typing import Any

import pytest
from explore.scenarios import (
    LIFT,
    NOTE,
    REST,
    STEP,
    WALK,
    WHERE,
    assert_good,
    counterexample,
    steps_once,
    walking,
)

import tca_tools.explore as tca
from tca_module import Outcome, PollingMonitor, Query, this
from tca_tools.check.world import JournalWorld
from tca_tools.explore import (
    achieved,
    at_most,
    before,
    begun,
    eventually,
    handled,
    killed,
    never,
    never_stuck,
    sent,
    within,
)
from tca_tools.explore.play.play import Action, ActionKind, Play
from tca_tools.explore.search.fingerprint import Detail, fingerprint_of

IS_LOW: Query[None, bool] = Query("is low", reply=bool)
GAUGE = PollingMonitor("gauge", condition=IS_LOW)


# --- time -----------------------------------------------------------------------------------------


def tea(*properties: tca.Property, order: tuple[str, str] = ("fast", "slow")) -> tca.Scenario:
    """Return a scenario: heating takes 1 s or 3 s, and pouring starts 3 s later."""
    scenario = tca.Scenario("tea", *properties)
    scenario.module("kettle", capacity=2).handles(STEP)(lambda _: None)

    @scenario.module("maid").handles(WALK)
    def make(task: tca.Task) -> None:
        heat = task.goal(REST)
        task.command(STEP, "pour", constraints=[heat.achieving.end + 3.0 <= this.achieving.start])

    @scenario.module("stove").handles(REST)
    def heat(task: tca.Task) -> None:
        task.command(STEP, "heat", delay=1.0 if task.choose(*order) == "fast" else 3.0)

    scenario.module("user").does(lambda me: [me.goal(WALK)])
    return scenario


def is_late(world: tca.World) -> list[tca.Seen]:
    return [
        task
        for task in world.tasks
        if world.now > 5 and task.message == STEP.name and task.data == "pour"
    ]


@pytest.mark.parametrize("order", [("fast", "slow"), ("slow", "fast")])
def test_property_of_time_is_judged_at_each_time(order: tuple[str, str]) -> None:
    """The same state is reached after 4 s and after 6 s, in either order of the search."""
    result = tca.explore(tea(never(is_late), order=order))
    assert result.violation is not None, tca.report(result)
    assert "3 s pass" in tca.report(result)


def polled(*properties: tca.Property, readers: int = 1) -> tca.Scenario:
    """Return a scenario: a battery is polled every second for ever. Each poll is a step of the
    handler.
    """
    scenario = tca.Scenario("polled", *properties)
    scenario.module("battery", capacity=readers).handles(IS_LOW)(lambda _: False)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        for _ in range(readers):
            me.monitor(GAUGE, period=1.0, waited_for=True)

    return scenario


def test_property_of_time_is_judged_after_all_states_are_known() -> None:
    assert_good(polled(never_stuck()))
    counterexample(polled(never(lambda world: world.now > 5)))


def test_property_of_time_is_unknown_in_endless_scenario() -> None:
    result = tca.explore(polled(never(lambda world: world.now < 0)), limit=50)
    assert "not known" in tca.report(result)


@pytest.mark.parametrize("order", [("fast", "slow"), ("slow", "fast")])
@pytest.mark.parametrize(
    ("seconds", "ok"), [(6.0, True), (5.9, False), pytest.param(6, True, marks=pytest.mark.soak)]
)
def test_within_holds_up_to_its_seconds(
    order: tuple[str, str], seconds: float, *, ok: bool
) -> None:
    result = tca.explore(tea(within(seconds, sent(WALK), begun(STEP, "pour")), order=order))
    assert result.ok is ok, tca.report(result)


def test_within_reports_elapsed_time() -> None:
    text = counterexample(tea(within(4.5, sent(WALK), begun(STEP, "pour"))))
    assert "tea: NOT step begun with data='pour' within 4.5 s of walk sent" in text
    assert "=> here 6 s have passed" in text


def test_within_measures_time_that_passes_in_the_same_action() -> None:
    """The pouring starts 3 s after the heating, in the same action in which time passes."""
    assert_good(tea(within(3.0, achieved(STEP, "heat"), begun(STEP, "pour"))))
    counterexample(tea(within(2.0, achieved(STEP, "heat"), begun(STEP, "pour"))))


def test_within_fails_when_run_ends_first() -> None:
    result = tca.explore(walking(within(5.0, achieved(WALK), killed(REST))))
    assert "the run may end here, and it never happened" in tca.report(result)


def test_within_keeps_scenario_finite() -> None:
    assert_good(polled(within(1.0, sent(IS_LOW), handled(IS_LOW))))
    counterexample(polled(within(1.0, sent(IS_LOW), handled(NOTE))))
    counterexample(
        polled(within(1.0, lambda world: not world.passed, lambda world: world.passed > 1))
    )


# --- names ----------------------------------------------------------------------------------------


def first_id(world: tca.World) -> object:
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
def test_id_supports_only_comparison_with_ids(looks: Any) -> None:
    with pytest.raises(
        tca.ScenarioError,
        match="an id has another number in each run, so it can only be compared with other ids",
    ):
        tca.explore(walking(never(looks)))


def test_messages_have_no_order() -> None:
    with pytest.raises(
        tca.ScenarioError, match="messages have no order here: select them by their attributes"
    ):
        tca.explore(walking(never(lambda world: world.tasks[0])))


def test_id_reveals_nothing_as_text_or_hash() -> None:
    """Neither its text nor the order of a set identifies an id."""
    texts: set[str] = set()

    def looks(world: tca.World) -> bool:
        texts.update(f"{seen} {seen.id!r}" for seen in world.messages)
        assert len({seen.id for seen in world.messages}) == len(world.messages)
        return len({hash(seen.id) for seen in world.messages}) > 1

    assert_good(walking(never(looks)))
    assert texts == {"walk an id", "rest an id", "step an id"}


def test_property_finds_relatives_of_task() -> None:
    def is_orphan(world: tca.World) -> list[tca.Seen]:
        return [
            task
            for task in world.tasks
            if task.message == STEP.name
            and (parent := world.parent(task)) is not None
            and (task not in world.children(parent) or parent.message != WALK.name)
        ]

    assert_good(walking(never(is_orphan)))
    counterexample(walking(never(lambda world: any(world.parent(one) for one in world.tasks))))


def test_property_sees_constraints_that_hold_task() -> None:
    def waits_for_the_first(world: tca.World) -> bool:
        return any(
            leader is not None and leader.data == 0
            for task in world.tasks
            if task.data == 1
            for _, _, leader in world.held(task)
        )

    counterexample(walking(never(waits_for_the_first)))


def test_property_sees_connected_modules() -> None:
    result = tca.explore(walking(never(lambda world: "legs" not in world.modules), may_be_lost=1))
    assert result.violation is not None
    assert_good(walking(never(lambda world: world.modules != ("legs", "planner", "user"))))


# --- vacuous properties ---------------------------------------------------------------------------


def test_vacuous_property_is_named() -> None:
    scenario = walking(
        before(achieved(WALK), begun(LIFT)),
        at_most(1, handled(LIFT)),
        within(1.0, sent(LIFT), achieved(LIFT)),
        before(achieved(WALK), achieved(REST)),
    )
    scenario.module("arm").handles(LIFT)(lambda _: None)
    result = tca.explore(scenario)
    assert result.ok
    assert tca.report(result).splitlines()[1:] == [
        "  holds vacuously: 'walk achieved before lift begun': 'lift begun' is never true",
        "  holds vacuously: 'at most 1 lift handled': 'lift handled' is never true",
        "  holds vacuously: 'lift achieved within 1 s of lift sent': 'lift sent' is never true",
    ]


def test_property_met_at_once_is_not_vacuous() -> None:
    """The rule also holds where the second event of *before* comes only after the first."""
    assert not tca.explore(
        walking(before(begun(WALK), achieved(REST)), at_most(3, begun(STEP)))
    ).vacuous


# --- endless runs --------------------------------------------------------------------------------


WATCHED = Detail(names=True)


def required_actions(play: Play) -> set[tuple[str, str]]:
    """Return the possible actions that must happen some time."""
    return {(action.kind, action.name) for action in play.actions() if not action.is_optional}


def fair_circle(result: tca.Result) -> tuple[Action, ...]:
    """Return the circle of a violation, after two passes through it."""
    assert result.violation is not None, tca.report(result)
    circle = result.violation.cycle
    assert circle
    play = Play(result.scenario)
    for action in result.violation.actions:
        play.perform(action)
    start, left_out = fingerprint_of(play, (), WATCHED)[0], required_actions(play)
    for _ in range(2):
        for action in circle:
            assert action in play.actions()
            play.perform(action)
            left_out = (left_out & required_actions(play)) - {(action.kind, action.name)}
        assert fingerprint_of(play, (), WATCHED)[0] == start
    assert not left_out, f"{left_out} can happen all the time, and never does"
    return circle


def beside_polling(walk: Any, *properties: tca.Property, readers: int = 1) -> tca.Scenario:
    """Return a scenario: a battery is polled every second for ever, beside a walk."""
    scenario = polled(*properties, readers=readers)
    scenario.module("planner").handles(WALK)(walk)
    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("walker").does(lambda me: [me.goal(WALK)])
    return scenario


def hangs(task: tca.Task) -> None:
    task.hang()


def starts_monitor(task: tca.Task) -> None:
    task.monitor(GAUGE, period=1.0, waited_for=True)


@pytest.mark.parametrize("never_met", [eventually(achieved(WALK)), never_stuck()])
def test_endless_activity_does_not_hide_missing_event(never_met: tca.Property) -> None:
    result = tca.explore(beside_polling(hangs, never_met))
    assert len(fair_circle(result)) == 2, "a second passes, and the question is answered"
    text = tca.report(result)
    assert "1 s pass" in text.partition("then this cycle repeats forever:\n")[2]
    assert text.endswith("=> this cycle can repeat forever, and it never happens") or (
        "this cycle can repeat forever, with this waiting throughout:\n     planner in walk {"
        in text
        and "waits forever" in text
    )


def test_fair_run_beside_endless_activity_is_good() -> None:
    """Runs in which a ready script never continues, or time stands still, do not count."""
    result = assert_good(beside_polling(steps_once, eventually(achieved(WALK)), never_stuck()))
    assert result.longest is None


def ping(note: Any, *properties: tca.Property) -> tca.Scenario:
    """Return a scenario with a note that its handler may send again, and with a step on the same
    legs.
    """
    scenario = tca.Scenario("ping", *properties)
    legs = scenario.module("legs")
    legs.handles(NOTE)(note)
    legs.handles(STEP)(lambda _: None)
    scenario.module("pinger").does(lambda me: me.inform(NOTE))
    scenario.module("walker").does(lambda me: [me.command(STEP)])
    return scenario


def repeats(task: tca.Task) -> None:
    task.inform(NOTE)


def may_repeat(task: tca.Task) -> None:
    if task.choose("again", "enough") == "again":
        task.inform(NOTE)


def test_queued_command_gets_its_turn() -> None:
    result = assert_good(ping(repeats, never_stuck(), eventually(achieved(STEP))))
    assert result.longest is None


def starving(priority: int, *properties: tca.Property) -> tca.Scenario:
    """Return a scenario: two queries alternate on the legs, and each may overtake a step."""
    scenario = tca.Scenario("starving", *properties)
    legs, ear = scenario.module("legs"), scenario.module("ear")
    legs.handles(STEP)(lambda _: None)

    @legs.handles(WHERE)
    def where(task: tca.Task) -> int:
        task.inform(NOTE)
        return 7

    @ear.handles(NOTE)
    def note(task: tca.Task) -> None:
        task.query_send(WHERE, priority=priority)

    scenario.module("pinger").does(lambda me: [me.inform(NOTE), me.inform(NOTE)])
    scenario.module("walker").does(lambda me: [me.command(STEP)])
    return scenario


def test_no_slot_starves_in_fair_run() -> None:
    """The battery is polled in one slot, and the step uses the other. Both slots must advance."""
    scenario = tca.Scenario("two slots", never_stuck(), eventually(achieved(STEP)))
    legs = scenario.module("legs", capacity=2)
    legs.handles(IS_LOW)(lambda _: False)
    legs.handles(STEP)(lambda _: None)
    scenario.module("user").does(lambda me: [me.monitor(GAUGE, period=1.0, waited_for=True)])
    scenario.module("walker").does(lambda me: [me.command(STEP)])
    assert_good(scenario)


@pytest.mark.soak
def test_starved_command_is_found() -> None:
    """The run is fair, because every other action has its turn. With equal priorities the command
    has its turn, too.
    """
    result = tca.explore(starving(1, never_stuck()))
    assert result.violation is not None, tca.report(result)
    assert "waiting throughout:\n     step {" in tca.report(result)
    assert "queued" in tca.report(result)
    assert {action.name for action in result.violation.cycle} >= {"legs/1", "ear/1"}
    assert_good(starving(0, never_stuck(), eventually(achieved(STEP))))
    counterexample(starving(1, eventually(achieved(STEP))))


def test_choice_may_be_repeated_for_ever() -> None:
    """A fair run need not make every choice."""
    only_again = ping(
        may_repeat, eventually(lambda world: not world.messages and world.modules == ())
    )
    assert "the run may end here" in counterexample(only_again)
    result = tca.explore(ping(may_repeat, eventually(has_ended)))
    assert result.violation is not None
    assert "chooses again" in tca.report(result).partition("repeats forever:")[2]
    assert_good(ping(may_repeat, never_stuck()))


def has_ended(world: tca.World) -> list[tca.Seen]:
    """Return the last note, if it was handled and sent no other."""
    notes = [seen for seen in world.messages if seen.message == NOTE.name]
    return [seen for seen in notes if seen.is_over and len(notes) == 1]


def test_world_needs_no_central() -> None:
    assert list(tca.World(JournalWorld([], is_whole=True), {}).messages) == []


@pytest.mark.soak
def test_fair_circle_polls_both_gauges() -> None:
    result = tca.explore(beside_polling(hangs, eventually(achieved(WALK)), readers=2))
    assert {action.name for action in fair_circle(result)} == {"", "battery/1", "battery/2"}


@pytest.mark.soak
def test_fair_circle_includes_both_independent_pairs() -> None:
    """A circle of one pair alone would be unfair, so it is not shown."""
    scenario = tca.Scenario("ball", eventually(achieved(WALK)))
    for name in ("here", "there"):
        ball: Any = type(NOTE)(f"ball {name}")
        scenario.module(name).handles(ball)(lambda task, ball=ball: task.inform(ball))
        scenario.module(f"{name} begins").does(lambda me, ball=ball: me.inform(ball))
    scenario.module("planner").handles(WALK)(hangs)
    scenario.module("walker").does(lambda me: [me.goal(WALK)])
    assert {action.name for action in fair_circle(tca.explore(scenario))} == {"here/1", "there/1"}


def test_optional_action_may_be_omitted_for_ever() -> None:
    """A run in which the module is never lost is fair, though the module may be lost."""
    scenario = polled(eventually(lambda world: "battery" not in world.modules))
    scenario.modules["battery"].may_be_lost = 1
    circle = fair_circle(tca.explore(scenario))
    assert {action.kind for action in circle} == {ActionKind.TIME, ActionKind.STEP}


def test_intermittent_action_may_be_omitted_for_ever() -> None:
    """A step always ends before its deadline, so a run in which no time passes is fair."""
    scenario = tca.Scenario("in time", eventually(begun(LIFT)))

    @scenario.module("ear").handles(NOTE)
    def on_note(task: tca.Task) -> None:
        in_time = task.command(STEP, deadline=1.0).wait() is Outcome.DONE
        if in_time:
            task.inform(NOTE)
        else:
            task.command(LIFT)

    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("arm").handles(LIFT)(lambda _: None)
    scenario.module("pinger").does(lambda me: me.inform(NOTE))
    assert {action.name for action in fair_circle(tca.explore(scenario))} == {"ear/1", "legs/1"}


@pytest.mark.soak
def test_goal_with_endless_subtask_is_not_stuck() -> None:
    """The goal waits for its subtask. Only the subtask could be stuck."""
    assert assert_good(beside_polling(starts_monitor, never_stuck())).longest is None


@pytest.mark.soak
def test_stuck_subtask_is_named_instead_of_its_goal() -> None:
    scenario = beside_polling(steps_once, never_stuck())
    scenario.modules["legs"].may_be_lost = 1
    result = tca.explore(scenario)
    fair_circle(result)
    assert (
        "this cycle can repeat forever, with this waiting throughout:\n     step {"
        in tca.report(result)
    )
    assert "queued" in tca.report(result)


# --- counts ----------------------------------------------------------------------------------------


def test_at_most_counts_end_before_start_in_one_action() -> None:
    """The count is that of ``tca check``: legs with one slot start one step at a time."""
    one_at_a_time = at_most(1, begun(STEP)), at_most(1, handled(STEP))
    assert_good(walking(*one_at_a_time, steps=3))
    counterexample(walking(at_most(0, begun(STEP))))
    counterexample(walking(at_most(0, achieved(STEP))))
