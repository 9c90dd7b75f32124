"""Rules of central for failures, wiretaps, monitors, suspension and time, broken one by one: each
is found.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
from explore import scenarios
from explore.scenarios import (
    BATTERY,
    CHECK,
    HIGHER,
    RECHARGE,
    REPLAN,
    REST,
    SLIPPED,
    STEP,
    WALK,
    resolves,
    slips,
)
from explore.test_rules import crowd
from explore.test_steering import parting, retried_while_running, walk_is_over
from msgspec.structs import replace

import tca_tools.explore as tca
from tca_central.control import steering
from tca_central.core import HANDLERS, REACHED
from tca_central.failing import failures
from tca_central.model.clock import Clock
from tca_central.model.contexts import FailureContext
from tca_central.model.deliveries import ModuleResource
from tca_central.model.tasks import Recovery, Watch
from tca_central.order.agenda import Agenda
from tca_central.order.dispatcher import Dispatcher
from tca_central.order.holds import Holds
from tca_central.requests import joining
from tca_central.requests.sending import on_send
from tca_central.state import TaskWait
from tca_central.watching import taps, watches
from tca_module import Condition
from tca_tools.explore import (
    achieved,
    at_most,
    at_most_in_all,
    before,
    begun,
    eventually,
    fired,
    handled_by,
    killed,
    never,
    never_stuck,
    retried,
    sent,
)
from tca_wire.packets.headers import Send
from tca_wire.packets.parts import WatchOptions

Patch = pytest.MonkeyPatch


def followers_are_released_too_early(patch: Patch) -> None:
    """By whatever their leader reaches."""
    real = Holds.release_followers
    patch.setattr(Holds, "release_followers", lambda self, task, _: real(self, task, 63))


def a_killed_task_releases_nobody(patch: Patch) -> None:
    real = Holds.release_followers
    patch.setattr(
        Holds,
        "release_followers",
        lambda self, task, at: [] if task.killed else real(self, task, at),
    )


def a_slot_is_given_twice(patch: Patch) -> None:
    patch.setattr(ModuleResource, "take_slot", lambda self: next(iter(self.slots), None))


def freed_slots_are_forgotten(patch: Patch) -> None:
    patch.setattr(Dispatcher, "offer_next", lambda self: self.to_offer.clear())


def a_parent_ends_before_its_children(patch: Patch) -> None:
    real = Agenda._may_reach
    patch.setattr(
        Agenda, "_may_reach", lambda self, task, moment: moment == 32 or real(self, task, moment)
    )


def a_before_tap_holds_nothing(patch: Patch) -> None:
    real = Holds.hold
    patch.setattr(
        Holds,
        "hold",
        staticmethod(
            lambda leader, at, task, moment, delay=0: (
                None if leader.role else real(leader, at, task, moment, delay)
            )
        ),
    )


def what_waits_when_a_tap_comes_does_not_pass_it(patch: Patch) -> None:
    patch.setattr(taps, "_apply_to_waiting", lambda *_: None)


def what_passed_a_tap_that_nobody_heard_does_not_pass_it_again(patch: Patch) -> None:
    patch.setattr(joining, "listeners_come", lambda *_: None)


def a_retry_does_not_wait_for_the_handler(patch: Patch) -> None:
    patch.setattr(
        Agenda,
        "_may_start",
        lambda self, task: not task.children if task.retrying else MAY_START(self, task),
    )


MAY_START = Agenda._may_start


def suspended_tasks_are_started(patch: Patch) -> None:
    def may_start(self: Agenda, task: Any) -> bool:
        was, task.suspended = task.suspended, False
        try:
            return MAY_START(self, task)
        finally:
            task.suspended = was

    patch.setattr(Agenda, "_may_start", may_start)


def attempts_are_not_told(patch: Patch) -> None:
    real = FailureContext.header.fget  # type: ignore[attr-defined]

    def header(self: FailureContext) -> Any:
        Recovery.of(self.failing).attempts = 1
        return real(self)

    patch.setattr(FailureContext, "header", property(header))


def a_reissued_failure_is_searched_from_the_start(patch: Patch) -> None:
    real = failures._call_handler

    def call(central: Any, task: Any, failure: Any, _below: Any = None, *, is_beside: bool) -> Any:
        return real(central, task, failure, is_beside=is_beside)

    patch.setattr(failures, "_call_handler", call)


def one_that_could_not_decide_is_the_last_that_is_asked(patch: Patch) -> None:
    patch.setattr(failures, "NOT_BY_CHOICE", frozenset())


def who_only_observes_has_dealt_with_it(patch: Patch) -> None:
    patch.setattr(failures, "_continue_unresolved", failures._recover)


def calls_of_a_handler_are_not_counted(patch: Patch) -> None:
    real = failures._find

    def find(task: Any, *others: Any) -> Any:
        for at in task.lineage():
            Recovery.of(at).invocations.clear()
        return real(task, *others)

    patch.setattr(failures, "_find", find)


def what_was_dealt_with_goes_on_for_ever(patch: Patch) -> None:
    patch.setattr(failures, "handler_ended", lambda _central, _handler: None)


def a_deadline_takes_the_task_from_its_handler(patch: Patch) -> None:
    patch.setattr(steering, "raise_failure", failures.fail_task)


def a_delay_is_no_delay(patch: Patch) -> None:
    real = Clock.after
    patch.setattr(
        Clock, "after", lambda self, seconds, due, subject: real(self, seconds / 2, due, subject)
    )


def a_monitor_acts_once_more(patch: Patch) -> None:
    patch.setattr(
        watches,
        "Watch",
        lambda task, options, *others, **named: Watch(task, once_more(options), *others, **named),
    )


def once_more(options: WatchOptions) -> WatchOptions:
    return replace(options, maximum=options.maximum + 1)


def a_late_kill_kills_nothing(patch: Patch) -> None:
    patch.setattr(steering.PendingKill, "carry_out", lambda _self, _central: None)


def nothing_is_done_on_termination(patch: Patch) -> None:
    patch.setattr(failures, "_after_kill", lambda _central, _task, _why: None)


def a_wait_is_never_over(patch: Patch) -> None:
    patch.setitem(REACHED, TaskWait, lambda _central, _wait, _task: None)


def what_nobody_handles_is_sent_all_the_same(patch: Patch) -> None:
    def send(central: Any, connection: Any, header: Send, body: bytes) -> None:
        on_send(central, connection, replace(header, if_handled=False), body)

    patch.setitem(HANDLERS, Send, send)


# --- what finds them ------------------------------------------------------------------------------


def once(*properties: Any, higher: Callable[[tca.Task], None]) -> tca.Scenario:
    """An exception handler that is called once, however often the step slips."""
    scenario = tca.Scenario("once", at_most_in_all(1, sent(HIGHER)), *properties)
    scenario.module("legs").handles(STEP)(slips)
    scenario.module("expert").handles(HIGHER)(higher)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.on_failure(SLIPPED, HIGHER, of=STEP, maximum=1)
        me.command(STEP)

    return scenario


def retries(task: tca.Task) -> None:
    task.trouble.failing.retry()


def may_look_on(task: tca.Task) -> None:
    if task.choose("looks on", "resolves") == "resolves":
        task.trouble.resolved()


def mortal(*properties: Any) -> tca.Scenario:
    """An exception handler whose module may die, and another one further out."""
    scenario = tca.Scenario("mortal", *properties)
    scenario.module("legs").handles(STEP)(slips)
    scenario.module("expert", may_be_lost=1).handles(HIGHER)(resolves)
    scenario.module("office").handles(REPLAN)(resolves)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.on_failure(SLIPPED, REPLAN)
        me.on_failure(SLIPPED, HIGHER, of=STEP)
        me.command(STEP)

    return scenario


def maybe(*properties: Any) -> tca.Scenario:
    """A walk that is only sent if somebody handles it, and nobody ever does."""
    scenario = tca.Scenario("maybe", *properties)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.execute_if_handled(WALK)

    return scenario


def delayed(*properties: Any) -> tca.Scenario:
    scenario = tca.Scenario("delayed", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.command(STEP, delay=2.0)

    return scenario


def lives_on(world: tca.World) -> list[tca.Seen]:
    return [
        task
        for task in world.tasks
        if task.message == WALK.name and world.now >= 1 and not task.is_killed
    ]


def walk_and_kill() -> tca.Result:
    in_order = before(achieved(STEP, 0), begun(STEP, 1))
    scenario = scenarios.walking(in_order, eventually(achieved(REST)), never_stuck())
    scenario.may_kill(WALK)
    return tca.explore(scenario)


IS_CHECKED = before(achieved(CHECK), begun(STEP))
BROKEN: dict[Callable[[Patch], None], Callable[[], tca.Result]] = {
    followers_are_released_too_early: walk_and_kill,
    a_killed_task_releases_nobody: walk_and_kill,
    a_parent_ends_before_its_children: walk_and_kill,
    freed_slots_are_forgotten: walk_and_kill,
    a_slot_is_given_twice: lambda: tca.explore(crowd(at_most(2, handled_by("legs")), notes=False)),
    a_before_tap_holds_nothing: lambda: tca.explore(scenarios.tapped(Condition.BEFORE_HANDLING)),
    what_waits_when_a_tap_comes_does_not_pass_it: lambda: tca.explore(
        scenarios.tapped_late(IS_CHECKED)
    ),
    what_passed_a_tap_that_nobody_heard_does_not_pass_it_again: lambda: tca.explore(
        scenarios.tapped_late(IS_CHECKED, safety_arrives_late=True)
    ),
    a_retry_does_not_wait_for_the_handler: lambda: tca.explore(retried_while_running()),
    suspended_tasks_are_started: lambda: tca.explore(scenarios.suspending()),
    attempts_are_not_told: lambda: tca.explore(scenarios.ladder(at_most_in_all(2, retried(STEP)))),
    a_reissued_failure_is_searched_from_the_start: lambda: tca.explore(
        scenarios.ladder(at_most_in_all(4, sent(HIGHER)))
    ),
    one_that_could_not_decide_is_the_last_that_is_asked: lambda: tca.explore(
        mortal(never(killed(STEP)))
    ),
    who_only_observes_has_dealt_with_it: lambda: tca.explore(once(higher=may_look_on)),
    calls_of_a_handler_are_not_counted: lambda: tca.explore(once(higher=retries)),
    what_was_dealt_with_goes_on_for_ever: lambda: tca.explore(once(never_stuck(), higher=resolves)),
    a_deadline_takes_the_task_from_its_handler: lambda: tca.explore(
        scenarios.late(never_stuck(), handled=True)
    ),
    a_delay_is_no_delay: lambda: tca.explore(delayed()),
    a_monitor_acts_once_more: lambda: tca.explore(
        scenarios.polling(BATTERY, at_most_in_all(1, fired(RECHARGE)), maximum=1)
    ),
    a_late_kill_kills_nothing: lambda: tca.explore(parting(never(lives_on))),
    nothing_is_done_on_termination: lambda: tca.explore(
        parting(before(achieved(REST), walk_is_over))
    ),
    a_wait_is_never_over: lambda: tca.explore(
        scenarios.late(never_stuck(), eventually(achieved(REST)))
    ),
    what_nobody_handles_is_sent_all_the_same: lambda: tca.explore(maybe(never_stuck())),
}


is_good = cache(lambda explored: explored().ok)
"""Before anything is broken."""


@pytest.mark.parametrize("mutation", BROKEN, ids=lambda mutation: mutation.__name__)
def test_broken_control_rule_is_found(
    monkeypatch: Patch, mutation: Callable[[Patch], None]
) -> None:
    """By promises and properties alone, without central's own invariants, and in a few actions."""
    assert is_good(BROKEN[mutation])
    mutation(monkeypatch)
    result = BROKEN[mutation]()
    assert result.violation is not None, tca.report(result)
    assert len(result.violation.actions) < 15, tca.report(result)
