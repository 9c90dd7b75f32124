"""A monitor never holds the end of the task that it watches over, unless the monitor is *waited
for*.
"""

from collections.abc import Callable
from typing import Any

import pytest
from explore.scenarios import (
    BATTERY,
    GAUGE,
    IS_LOW,
    RECHARGE,
    STEP,
    assert_good,
    counterexample,
    nothing,
)
from sampling import one_in

import tca_tools.explore as tca
from tca_module import Command, Condition, Inform, PollingMonitor, Refused, Task, this
from tca_tools.explore import achieved, at_most_in_all, before, eventually, never, never_stuck, sent
from tca_wire.vocabulary import Refusal

BEGINS = Inform("begins")
MOVE = Command("move")


def stepping(step: Callable[[Task], object] = nothing, *, is_low: bool = False) -> tca.Scenario:
    """Return a scenario with a step, and with a battery that is low or not."""
    scenario = tca.Scenario("a step that is watched")
    scenario.module("legs").handles(STEP)(step)
    scenario.module("body").handles(IS_LOW)(lambda _: is_low)
    scenario.module("user").does(lambda me: me.command(STEP).wait())
    return scenario


def starting(monitor: PollingMonitor[None], **options: Any) -> Callable[[Task], None]:
    """Return a handler of a step, which starts a monitor."""

    def step(task: Task) -> None:
        task.monitor(monitor, **options)

    return step


def monitor_tapped_task(task: Task, **options: Any) -> None:
    """Start a monitor under the tapped task, as docs/concepts/monitors.md advises."""
    assert task.tap_event.tapped is not None
    try:
        task.under(task.tap_event.tapped).monitor(GAUGE, period=1.0, **options)
    except Refused as refused:
        if refused.refusal is not Refusal.TOO_LATE:
            raise


CONDITIONS = [
    Condition.WHEN_SENT,
    Condition.BEFORE_HANDLING,
    Condition.WHILE_HANDLING,
    Condition.WHILE_ACHIEVING,
]
BOUNDS: dict[str, dict[str, Any]] = {"endless": {}, "bounded": {"maximum": 1}}


@pytest.mark.parametrize(("condition", "bounds"), one_in(4, CONDITIONS, BOUNDS))
def test_monitor_sent_by_listener_ends_with_tapped_task(condition: Condition, bounds: str) -> None:
    options = BOUNDS[bounds]
    scenario = stepping()
    watcher = scenario.module("watcher")
    watcher.handles(BEGINS)(lambda task: monitor_tapped_task(task, **options))
    watcher.at_start(lambda me: me.tap(condition, STEP, BEGINS))
    assert_good(scenario, eventually(achieved(STEP)), never_stuck())
    counterexample(scenario, never(sent(GAUGE)))


@pytest.mark.soak
@pytest.mark.parametrize(
    "options", [{}, {"maximum": 1}, {"duration": 9.0}], ids=["endless", "bounded", "for a time"]
)
def test_monitor_sent_by_handler_ends_with_its_task(options: dict[str, Any]) -> None:
    scenario = stepping(starting(GAUGE, period=1.0, **options))
    assert_good(scenario, eventually(achieved(STEP)), never_stuck())


@pytest.mark.soak
@pytest.mark.parametrize("options", [{}, {"maximum": 1}], ids=["endless", "bounded"])
def test_monitor_sent_by_foreign_module_ends_with_task(options: dict[str, Any]) -> None:
    scenario = stepping()

    @scenario.module("watcher").does
    def watch(me: tca.Script) -> None:
        for step in me.tasks(STEP):
            try:
                me.under(step).monitor(GAUGE, period=1.0, **options)
            except Refused as refused:
                if refused.refusal is not Refusal.TOO_LATE:
                    raise

    assert_good(scenario, eventually(achieved(STEP)), never_stuck())
    counterexample(scenario, never(sent(GAUGE)))


@pytest.mark.parametrize(
    "condition", [Condition.WHEN_SENT, Condition.WHILE_HANDLING, Condition.WHILE_ACHIEVING]
)
def test_monitor_as_listener_ends_with_tapped_task(condition: Condition) -> None:
    scenario = stepping()
    scenario.module("watcher").at_start(lambda me: me.tap(condition, STEP, GAUGE, period=1.0))
    assert_good(
        scenario, eventually(achieved(STEP)), before(achieved(GAUGE), achieved(STEP)), never_stuck()
    )
    counterexample(scenario, never(sent(GAUGE)))


def test_task_with_acting_monitor_ends() -> None:
    scenario = stepping(starting(BATTERY, period=1.0, maximum=1), is_low=True)
    scenario.module("dock").handles(RECHARGE)(nothing)
    assert_good(scenario, eventually(achieved(STEP)), never_stuck())
    counterexample(scenario, never(sent(RECHARGE)))


def test_task_waits_for_monitor_with_waited_for() -> None:
    scenario = stepping(starting(BATTERY, period=1.0, maximum=1, waited_for=True), is_low=True)
    scenario.module("dock").handles(RECHARGE)(nothing)
    assert_good(
        scenario,
        eventually(achieved(STEP)),
        before(achieved(RECHARGE), achieved(STEP)),
        at_most_in_all(1, sent(RECHARGE)),
    )
    counterexample(
        stepping(starting(GAUGE, period=1.0, waited_for=True)), eventually(achieved(STEP))
    )


@pytest.mark.soak
@pytest.mark.parametrize("waited_for", [False, True])
def test_command_after_monitor_needs_waited_for(waited_for: bool) -> None:
    def step(task: Task) -> None:
        battery = task.monitor(BATTERY, period=1.0, maximum=1, waited_for=waited_for)
        try:
            assert task.command(
                MOVE, constraints=[battery.achieving.end <= this.achieving.start]
            ).id
        except Refused as refused:
            if refused.refusal is not Refusal.CYCLE:
                raise

    scenario = stepping(step, is_low=waited_for)
    scenario.module("dock").handles(RECHARGE)(nothing)
    scenario.module("wheels").handles(MOVE)(nothing)
    moves = eventually(achieved(MOVE)) if waited_for else never(sent(MOVE))
    assert_good(
        scenario,
        eventually(achieved(STEP)),
        never_stuck(),
        before(achieved(BATTERY), achieved(MOVE)),
        moves,
    )


def suspends(task: Task) -> None:
    task.monitor(
        GAUGE, period=1.0, constraints=[task.handling.start + 9.0 <= this.handling.start]
    ).suspend()


def test_suspended_monitor_ends_with_its_task() -> None:
    scenario = stepping(suspends)
    assert_good(scenario, eventually(achieved(STEP)), never_stuck())


@pytest.mark.soak
def test_fired_monitor_tests_at_once() -> None:
    scenario = tca.Scenario("fired")
    scenario.module("body").handles(IS_LOW)(lambda _: True)
    scenario.module("dock", capacity=2).handles(RECHARGE)(nothing)

    @scenario.module("user").does
    def fires(me: tca.Script) -> None:
        battery = me.monitor(BATTERY, period=1000.0, initial_wait=True, maximum=2)
        me.fire(battery)  # False after the end of the monitor
        me.fire(BATTERY)
        battery.wait()

    assert_good(
        scenario,
        at_most_in_all(2, sent(IS_LOW)),
        at_most_in_all(2, sent(RECHARGE)),
        eventually(achieved(BATTERY)),
    )
    counterexample(scenario, at_most_in_all(1, sent(RECHARGE)))
