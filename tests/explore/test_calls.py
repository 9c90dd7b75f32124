"""Calls of the module library have the same effect in scripts as on the robot."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from explore.scenarios import (
    BATTERY,
    CHECK,
    HEIGHTS,
    HIGHER,
    IS_LOW,
    LIFT,
    NOTE,
    RECHARGE,
    REST,
    SLIPPED,
    STEP,
    WALK,
    WHERE,
    assert_good,
    counterexample,
)

import tca_tools.explore as tca
from tca_module import Condition, Refused, TaskFailed, TaskKilled, Timeout, this
from tca_module import Task as ModuleTask
from tca_tools.explore import (
    achieved,
    at_most_in_all,
    before,
    begun,
    fired,
    killed,
    never,
    never_stuck,
    sent,
)
from tca_wire.messages.controls import DemonMonitor, PointMonitor
from tca_wire.messages.declarations import Command, Variable
from tca_wire.vocabulary import Outcome, Scope

ROCKS = DemonMonitor("rocks", set_up=LIFT, action=NOTE)
GROUND = PointMonitor("ground", condition=IS_LOW, action=RECHARGE)
PACE: Variable[int] = Variable("pace", int)


def robot(
    walk: Callable[..., object], *properties: Any, **others: Callable[..., object]
) -> tca.Scenario:
    """Return a scenario: a user sends a walk, *walk* handles it, and one module handles all other
    messages.
    """
    scenario = tca.Scenario("a robot", *properties)
    scenario.module("planner").handles(WALK)(walk)
    module = scenario.module("others", capacity=2)
    results: dict[str, Any] = {WHERE.name: 7, HEIGHTS.name: 7, IS_LOW.name: True}

    def act(task: tca.Task) -> Any:
        return others[task.message](task) if task.message in others else results.get(task.message)

    for message in (STEP, WHERE, HEIGHTS, NOTE, LIFT, REST, CHECK, IS_LOW, RECHARGE, HIGHER):
        module.handles(message)(act)
    scenario.module("user").does(lambda me: [me.goal(WALK).wait()])
    return scenario


def assert_playable(
    walk: Callable[..., object], *properties: Any, **others: Callable[..., object]
) -> None:
    assert_good(robot(walk, *properties, **others), never_stuck(), limit=5000)


def test_scenario_task_is_the_librarys_own() -> None:
    assert issubclass(tca.Task, ModuleTask)
    assert {name for name in vars(tca.Script.__mro__[1]) if not name.startswith("_")} == {
        "choose",
        "hang",
        "use_kept",
    }


def test_order_blocks_constrain_tasks() -> None:
    def walk(task: tca.Task) -> None:
        with task.parallel():
            task.command(STEP, 1)
            task.command(STEP, 2)
        task.command(STEP, 3)

    assert_playable(walk, *(before(achieved(STEP, number), begun(STEP, 3)) for number in (1, 2)))
    counterexample(robot(walk, before(achieved(STEP, 1), begun(STEP, 2))))


def test_script_receives_results_and_failures() -> None:
    def walk(task: tca.Task) -> None:
        with contextlib.suppress(TaskFailed, TaskKilled):
            assert task.command(STEP).result() == "well"
            task.inform(NOTE, "well")

    def step(task: tca.Task) -> str:
        if task.choose("well", "badly") == "badly":
            raise SLIPPED(text="ice")
        return "well"

    assert_playable(walk, step=step)
    for data in ("well",):
        counterexample(robot(walk, never(sent(NOTE, data)), step=step))


def test_script_receives_answers_later() -> None:
    def walk(task: tca.Task) -> None:
        where = task.query_send(WHERE)
        task.command(STEP, 1)
        assert where.receive() == 7
        assert list(task.multi_query_send(HEIGHTS, maximum=1)) == [7]
        given_up = task.query_send(WHERE)
        given_up.cancel()

    assert_playable(walk)


def test_script_finds_relatives_of_task() -> None:
    def walk(task: tca.Task) -> None:
        task.command(STEP, "left", constraints=[task.handling.end <= this.achieving.start])
        (step,) = task.ref.children(STEP)
        assert step.data(STEP) == "left"
        parent = step.parent()
        assert parent is not None
        assert parent.id == task.id
        assert [above.message for above in step.ancestors()] == [WALK.name]
        step.kill("not needed")
        info = step.info()
        assert info is None

    assert_playable(walk, never(begun(STEP)))


def test_kill_respects_scope_and_point() -> None:
    def walk(task: tca.Task) -> None:
        later = [task.handling.end <= this.achieving.start]
        second, third = (task.command(STEP, number, constraints=later) for number in (2, 3))
        second.kill(scope=Scope.SIBLINGS)
        task.command(STEP, 4, constraints=[second.achieving.end <= this.achieving.start])
        task.ref.kill(after=second.achieving.end, scope=Scope.DESCENDANTS)
        assert third.wait_for(third.achieving.end) is Outcome.KILLED

    assert_playable(
        walk,
        never(begun(STEP, 3)),
        never(begun(STEP, 4)),
        never(killed(WALK)),
        before(killed(STEP, 3), begun(STEP, 2)),
    )


@pytest.mark.soak
def test_monitor_of_each_kind_acts() -> None:
    def walk(task: tca.Task) -> None:
        kind = task.choose("rocks", "ground", "battery")
        if kind == "rocks":
            rocks = task.monitor(ROCKS, maximum=1)
            with contextlib.suppress(Refused):  # the monitor has ended
                rocks.end()
        elif kind == "ground":
            task.monitor(GROUND)
        else:
            task.monitor(BATTERY, period=1.0, waited_for=True).end()

    def lift(task: tca.Task) -> None:
        with contextlib.suppress(Refused):
            task.monitor_ref.fire(NOTE, "a rock")

    assert_playable(walk, at_most_in_all(1, fired(NOTE)), lift=lift)
    assert 'fires rocks {2} with "a rock"' in counterexample(
        robot(walk, never(sent(NOTE)), lift=lift)
    )


def test_listener_receives_its_tap_event() -> None:
    heard = set()

    def walk(task: tca.Task) -> None:
        held = task.command(STEP, 1, constraints=[task.handling.end <= this.achieving.start])
        tap = task.tap(Condition.AFTER_ACHIEVED, held, CHECK)
        task.tap(Condition.AFTER_ACHIEVED, STEP, NOTE)
        tap.remove()
        task.command(STEP, 2)

    def note(task: tca.Task) -> None:
        assert task.tap_event.tapped is not None
        heard.add((task.tap_event.condition, task.tap_event.message))

    assert_playable(walk, never(sent(CHECK)), at_most_in_all(2, fired(NOTE)), note=note)
    assert heard == {(Condition.AFTER_ACHIEVED, STEP.name)}


def test_script_uses_variables_and_sends_if_handled() -> None:
    def walk(task: tca.Task) -> None:
        assert task.get_variable(PACE, 0) == 0
        task.set_variable(PACE, 3)
        assert task.swap_variable(PACE, 4) == 3
        task.wait_until_handled(STEP)
        assert task.execute_if_handled(Command("dance")) is None
        ref = task.execute_if_handled(STEP, 1)
        assert ref is not None
        assert task.execute(WHERE) == 7

    assert_playable(walk)


def test_suspended_handler_may_hold() -> None:
    def walk(task: tca.Task) -> None:
        task.command(STEP)

    def step(task: tca.Task) -> None:
        if task.suspended and not task.cancelled:
            task.query(WHERE)

    scenario = robot(walk, step=step)
    scenario.may_suspend(WALK)
    assert_good(scenario, never_stuck(), limit=3000)
    counterexample(scenario, never(sent(WHERE)))


# --- unexplored calls ----------------------------------------------------------------------------


def lists_modules(task: tca.Task) -> None:
    task.modules()


def sleeps(task: tca.Task) -> None:
    task.sleep(1.0)


def uses_callback(task: tca.Task) -> None:
    task.query_notify(WHERE, None, lambda *_: None)


def sends_multi_query_with_timeout(task: tca.Task) -> None:
    task.multi_query(HEIGHTS, timeout=1.0)


def awaits(task: tca.Task) -> Iterator[Any]:
    return next(task.command(STEP).__await__())


def suppresses_errors(task: tca.Task) -> None:
    with contextlib.suppress(Exception):
        task.handlers(STEP)


async def is_async(_: tca.Task) -> None: ...


def sends_wrong_data(task: tca.Task) -> None:
    task.set_variable(PACE, "fast")  # type: ignore[misc]


def chooses_for_ever(task: tca.Task) -> None:
    while task.choose(True, False) or True:
        pass


@pytest.mark.parametrize(
    ("handler", "words"),
    [
        (
            lists_modules,
            r"line \d+\): modules\(\), handlers\(\) and status\(\) is not explored: leave it out",
        ),
        (sleeps, r"sleep\(\) and wait_until\(\) is not explored"),
        (uses_callback, r"query_notify\(\) is not explored"),
        (sends_multi_query_with_timeout, r"multi_query\(timeout=...\) is not explored"),
        (awaits, "await is not explored"),
        (suppresses_errors, r"handlers\(\) and status\(\) is not explored"),
        (is_async, "make it a plain function"),
        (sends_wrong_data, "variable 'pace' wants data of type int"),
        (chooses_for_ever, "decides 100 times without sending or asking anything"),
    ],
)
def test_unexplored_call_is_named(handler: Any, words: str) -> None:
    with pytest.raises(tca.ScenarioError, match=words):
        tca.explore(robot(handler))


def test_handler_of_monitor_is_refused() -> None:
    with pytest.raises(tca.ScenarioError, match="central carries it out"):
        tca.Scenario("bad").module("eye").handles(BATTERY)


def test_message_with_two_formats_is_named() -> None:
    def walk(task: tca.Task) -> None:
        task.command(Command(STEP.name, int), 3)

    with pytest.raises(tca.ScenarioError, match="two formats for message 'step'"):
        tca.explore(robot(walk))


def test_query_timeout_is_explored() -> None:
    def walk(task: tca.Task) -> None:
        try:
            task.query(WHERE, timeout=2.0)
        except Timeout:
            task.inform(NOTE, "late")

    assert_playable(walk)
    counterexample(robot(walk, never(sent(NOTE, "late"))))
