"""Rules of central are broken one at a time: for failures, wiretaps, monitors, suspension and time.
The explorer finds each of them.
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
from sampling import every

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


def early_release_of_followers(patch: Patch) -> None:
    """Every point of a leader releases its followers."""
    real = Holds.release_followers
    patch.setattr(Holds, "release_followers", lambda self, task, _: real(self, task, 63))


def no_release_by_killed_task(patch: Patch) -> None:
    real = Holds.release_followers
    patch.setattr(
        Holds,
        "release_followers",
        lambda self, task, at: [] if task.killed else real(self, task, at),
    )


def slot_used_twice(patch: Patch) -> None:
    patch.setattr(ModuleResource, "acquire_slot", lambda self: next(iter(self.slots), None))


def freed_slot_forgotten(patch: Patch) -> None:
    patch.setattr(Dispatcher, "refill_next", lambda self: self.to_refill.clear())


def parent_ends_first(patch: Patch) -> None:
    real = Agenda._may_reach
    patch.setattr(
        Agenda, "_may_reach", lambda self, task, moment: moment == 32 or real(self, task, moment)
    )


def before_tap_without_hold(patch: Patch) -> None:
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


def late_tap_ignored(patch: Patch) -> None:
    patch.setattr(taps, "_apply_to_waiting", lambda *_: None)


def late_listener_ignored(patch: Patch) -> None:
    patch.setattr(joining, "on_listeners_added", lambda *_: None)


def retry_beside_handler(patch: Patch) -> None:
    patch.setattr(
        Agenda,
        "_may_start",
        lambda self, task: not task.children if task.retry_pending else MAY_START(self, task),
    )


MAY_START = Agenda._may_start


def suspended_task_started(patch: Patch) -> None:
    def may_start(self: Agenda, task: Any) -> bool:
        was, task.suspended = task.suspended, False
        try:
            return MAY_START(self, task)
        finally:
            task.suspended = was

    patch.setattr(Agenda, "_may_start", may_start)


def constant_attempts(patch: Patch) -> None:
    real = FailureContext.header.fget  # type: ignore[attr-defined]

    def header(self: FailureContext) -> Any:
        Recovery.of(self.failing).attempts = 1
        return real(self)

    patch.setattr(FailureContext, "header", property(header))


def reissue_searches_from_start(patch: Patch) -> None:
    real = failures._call_handler

    def call(
        central: Any, task: Any, failure: Any, _previous: Any = None, *, from_outside: bool
    ) -> Any:
        return real(central, task, failure, from_outside=from_outside)

    patch.setattr(failures, "_call_handler", call)


def search_ends_at_failed_handler(patch: Patch) -> None:
    patch.setattr(failures, "NOT_BY_CHOICE", frozenset())


def unresolved_failure_recovered(patch: Patch) -> None:
    patch.setattr(failures, "_continue_unresolved", failures._recover)


def uncounted_calls(patch: Patch) -> None:
    real = failures._find_handler

    def find(task: Any, *others: Any) -> Any:
        for at in task.lineage():
            Recovery.of(at).invocations.clear()
        return real(task, *others)

    patch.setattr(failures, "_find_handler", find)


def endless_recovery(patch: Patch) -> None:
    patch.setattr(failures, "on_exception_handler_ended", lambda _central, _handler: None)


def deadline_ends_handling(patch: Patch) -> None:
    patch.setattr(steering, "raise_failure", failures.fail_task)


def halved_delay(patch: Patch) -> None:
    real = Clock.after
    patch.setattr(
        Clock, "after", lambda self, seconds, due, subject: real(self, seconds / 2, due, subject)
    )


def extra_monitor_action(patch: Patch) -> None:
    patch.setattr(
        watches,
        "Watch",
        lambda task, options, *others, **named: Watch(
            task, with_extra_action(options), *others, **named
        ),
    )


def with_extra_action(options: WatchOptions) -> WatchOptions:
    return replace(options, maximum=options.maximum + 1)


def lost_late_kill(patch: Patch) -> None:
    patch.setattr(steering.PendingKill, "carry_out", lambda _self, _central: None)


def lost_termination_message(patch: Patch) -> None:
    patch.setattr(failures, "_after_kill", lambda _central, _task, _why: None)


def endless_wait(patch: Patch) -> None:
    patch.setitem(REACHED, TaskWait, lambda _central, _wait, _task: None)


def unhandled_message_sent(patch: Patch) -> None:
    def send(central: Any, connection: Any, header: Send, body: bytes) -> None:
        on_send(central, connection, replace(header, if_handled=False), body)

    patch.setitem(HANDLERS, Send, send)


# --- scenarios ------------------------------------------------------------------------------------


def called_once(*properties: Any, higher: Callable[[tca.Task], None]) -> tca.Scenario:
    """Return a scenario: a step slips each time. Its exception handler is called once at most."""
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


def may_resolve(task: tca.Task) -> None:
    if task.choose("looks on", "resolves") == "resolves":
        task.trouble.resolved()


def with_mortal_handler(*properties: Any) -> tca.Scenario:
    """Return a scenario with an exception handler whose module may be lost, and another one
    attached to the root.
    """
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


def sent_if_handled(*properties: Any) -> tca.Scenario:
    """Return a scenario with a walk without a handler, sent *if handled*."""
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


def living_walks(world: tca.World) -> list[tca.Seen]:
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
    early_release_of_followers: walk_and_kill,
    no_release_by_killed_task: walk_and_kill,
    parent_ends_first: walk_and_kill,
    freed_slot_forgotten: walk_and_kill,
    slot_used_twice: lambda: tca.explore(crowd(at_most(2, handled_by("legs")), notes=False)),
    before_tap_without_hold: lambda: tca.explore(scenarios.tapped(Condition.BEFORE_HANDLING)),
    late_tap_ignored: lambda: tca.explore(scenarios.tapped_late(IS_CHECKED)),
    late_listener_ignored: lambda: tca.explore(
        scenarios.tapped_late(IS_CHECKED, safety_arrives_late=True)
    ),
    retry_beside_handler: lambda: tca.explore(retried_while_running()),
    suspended_task_started: lambda: tca.explore(scenarios.suspending()),
    constant_attempts: lambda: tca.explore(scenarios.ladder(at_most_in_all(2, retried(STEP)))),
    reissue_searches_from_start: lambda: tca.explore(
        scenarios.ladder(at_most_in_all(4, sent(HIGHER)))
    ),
    search_ends_at_failed_handler: lambda: tca.explore(with_mortal_handler(never(killed(STEP)))),
    unresolved_failure_recovered: lambda: tca.explore(called_once(higher=may_resolve)),
    uncounted_calls: lambda: tca.explore(called_once(higher=retries)),
    endless_recovery: lambda: tca.explore(called_once(never_stuck(), higher=resolves)),
    deadline_ends_handling: lambda: tca.explore(scenarios.late(never_stuck(), handled=True)),
    halved_delay: lambda: tca.explore(delayed()),
    extra_monitor_action: lambda: tca.explore(
        scenarios.polling(BATTERY, at_most_in_all(1, fired(RECHARGE)), maximum=1)
    ),
    lost_late_kill: lambda: tca.explore(parting(never(living_walks))),
    lost_termination_message: lambda: tca.explore(parting(before(achieved(REST), walk_is_over))),
    endless_wait: lambda: tca.explore(scenarios.late(never_stuck(), eventually(achieved(REST)))),
    unhandled_message_sent: lambda: tca.explore(sent_if_handled(never_stuck())),
}


is_good = cache(lambda explored: explored().ok)
"""A function: whether a scenario is good before a rule is broken. Its results are kept."""


@pytest.mark.parametrize("mutation", every(4, BROKEN), ids=lambda mutation: mutation.__name__)
def test_broken_control_rule_is_found(
    monkeypatch: Patch, mutation: Callable[[Patch], None]
) -> None:
    """Promises and properties find the broken rule in few actions, without a check of central's
    invariants.
    """
    assert is_good(BROKEN[mutation])
    mutation(monkeypatch)
    result = BROKEN[mutation]()
    assert result.violation is not None, tca.report(result)
    assert len(result.violation.actions) < 15, tca.report(result)
