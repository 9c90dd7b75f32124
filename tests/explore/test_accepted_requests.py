"""Central fulfils each accepted request, or reports why not, whatever happens in between. No task
may be stuck.

Each request has a small scenario. Requests about a task share one scenario (accepting.py). A table
says when each of them is *kept*, that is, fulfilled. Timers and later replies are left out, because
modules handle them alone. Messages, variables and resources are in test_answered_requests.py.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from explore.accepting import (
    BETWEEN,
    EVENTUALLY,
    HELP,
    LOST,
    assert_holds,
    has_ended,
    kept_at_once,
    messages_with,
    robot,
)
from explore.scenarios import (
    BATTERY,
    GAUGE,
    IS_LOW,
    LIFT,
    NOTE,
    RECHARGE,
    REST,
    SLIPPED,
    STEP,
    WALK,
    nothing,
    slips_or_not,
)
from sampling import one_in

import tca_tools.explore as tca
from tca_module import Condition, Scope, this
from tca_module.sending.task_ref import TaskRef
from tca_tools.explore import (
    accepted,
    achieved,
    at_most_in_all,
    before,
    begun,
    eventually,
    failed,
    fired,
    killed,
    never,
    sent,
    within,
)
from tca_wire.messages.controls import DemonMonitor, PointMonitor
from tca_wire.points import Moment

ROCKS = DemonMonitor("rocks", set_up=REST, action=NOTE)
GROUND = PointMonitor("ground", condition=IS_LOW, action=RECHARGE)

SOAKED_LOSS = pytest.param(LOST, marks=pytest.mark.soak)


def after_handler(task: tca.Task) -> Any:
    """Return the constraint that a task starts after the handler of *task* has returned."""
    return task.handling.end <= this.achieving.start


# --- wiretaps and exception handlers --------------------------------------------------------------


def has(moment: Moment) -> Callable[[tca.World], list[tca.Seen]]:
    """Return a function for the rests that have reached *moment*, and were not killed."""
    return lambda world: [
        rest for rest in messages_with(world, REST) if rest.has(moment) and not rest.is_killed
    ]


COMES_TRUE: dict[Condition, Callable[[tca.World], object]] = {
    Condition.WHEN_SENT: sent(REST),
    Condition.BEFORE_HANDLING: begun(REST),
    Condition.WHILE_HANDLING: begun(REST),
    Condition.AFTER_HANDLED: has(Moment.END_HANDLING),
    Condition.AFTER_SUCCESS: has(Moment.END_HANDLING),
    Condition.WHEN_SUCCESS: has(Moment.END_HANDLING),
    Condition.AFTER_FAILURE: failed(REST),
    Condition.WHEN_FAILURE: failed(REST),
    Condition.BEFORE_PLANNING: has(Moment.START_PLANNING),
    Condition.WHILE_PLANNING: has(Moment.START_PLANNING),
    Condition.AFTER_PLANNED: has(Moment.END_PLANNING),
    Condition.WHEN_PLANNED: has(Moment.END_PLANNING),
    Condition.BEFORE_ACHIEVING: has(Moment.START_ACHIEVING),
    Condition.WHILE_ACHIEVING: has(Moment.START_ACHIEVING),
    Condition.AFTER_ACHIEVED: achieved(REST),
    Condition.WHEN_ACHIEVED: achieved(REST),
    Condition.WHEN_KILLED: killed(REST),
}


def tapped(title: str, tap: Callable[[tca.Script], object]) -> tca.Scenario:
    """Return a scenario with a tapped rest that may fail, be killed, or be lost with its module."""
    scenario = tca.Scenario(title)
    scenario.module("couch", may_be_lost=1, comes_back=True).handles(REST)(slips_or_not)
    ear = scenario.module("ear")
    for listener in (LIFT, WALK):
        ear.handles(listener)(nothing)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        tap(me)
        me.goal(REST)

    scenario.may_kill(REST)
    return scenario


@pytest.mark.parametrize(
    "condition",
    [
        pytest.param(one, marks=[pytest.mark.soak] * (at % 16 > 0))
        for at, one in enumerate(COMES_TRUE)
    ],
)
def test_wiretap_fires_when_its_condition_comes_true(condition: Condition) -> None:
    holds_planning = condition in (Condition.BEFORE_PLANNING, Condition.WHEN_PLANNED)
    listener = WALK if holds_planning else LIFT  # the planning of a goal can be awaited
    scenario = tapped(condition, lambda me: me.tap(condition, REST, listener))
    assert_holds(
        scenario, before(fired(listener), COMES_TRUE[condition]), eventually(accepted("tap"))
    )


def test_removed_wiretap_does_not_fire() -> None:
    scenario = tapped("removed", lambda me: me.tap(Condition.WHEN_SENT, REST, LIFT).remove())
    assert_holds(scenario, never(sent(LIFT)), eventually(accepted("remove")))


def helped(task: tca.Task) -> None:
    if task.trouble.attempts > 1:
        raise task.trouble.reissue()
    task.trouble.failing.retry()


def help_after_removal(world: tca.World) -> list[tca.Seen]:
    return [
        one
        for one in messages_with(world, HELP)
        if (step := world.parent(one)) is not None and step.data == "alone"
    ]


@pytest.mark.soak
def test_exception_handler_is_called_until_removed() -> None:
    """The exception handler is called for failures of the handler and for lost modules, and only
    once.
    """
    scenario = tca.Scenario("help")
    scenario.module("legs", **LOST).handles(STEP)(slips_or_not)
    scenario.module("others").handles(HELP)(helped)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        attached = me.on_failure(None, HELP, of=STEP)
        if me.choose("keeps it", "removes it") == "keeps it":
            me.command(STEP, "helped")
        else:
            attached.remove()
            me.command(STEP, "alone")

    assert_holds(
        scenario,
        before(begun(HELP), failed(STEP, "helped")),
        never(help_after_removal),
        within(EVENTUALLY, accepted("remove"), has_ended(STEP, "alone")),
    )


# --- monitors -------------------------------------------------------------------------------------


def low(task: tca.Task) -> bool:
    return bool(task.choose(True, False))


def watched(watch: Callable[[tca.Script], object], **battery: Any) -> tca.Scenario:
    """Return a scenario: a user watches a battery, which other modules read and charge."""
    scenario = tca.Scenario("watched")
    scenario.module("battery", **battery).handles(IS_LOW)(low)
    dock = scenario.module("dock")
    for message in (RECHARGE, NOTE, REST):
        dock.handles(message)(nothing)
    scenario.module("user").does(lambda me: [watch(me)])
    return scenario


def watching(world: tca.World) -> list[tca.Seen]:
    """Return the monitors that have neither ended nor been killed."""
    return [
        one
        for one in world.tasks
        if one.message_class.is_monitor and not (one.is_killed or one.is_over)
    ]


MONITORS: dict[str, tuple[Any, Callable[[tca.Script], Any], list[Any]]] = {
    "once": (GROUND, lambda me: me.monitor(GROUND), [at_most_in_all(1, sent(IS_LOW))]),
    "for 2.5 s": (
        BATTERY,
        lambda me: me.monitor(BATTERY, period=1.0, duration=2.5, maximum=1),
        [
            within(
                2.5, sent(BATTERY), lambda world: not watching(world) or has_ended(BATTERY)(world)
            )
        ],
    ),
    "until the end of a rest": (
        GAUGE,
        lambda me: me.monitor(GAUGE, period=1.0, until=me.goal(REST).achieving.end),
        [within(EVENTUALLY, achieved(REST), lambda world: not watching(world))],
    ),
}


@pytest.mark.parametrize("battery", [{}, SOAKED_LOSS], ids=["no loss", "loss"])
@pytest.mark.parametrize("name", MONITORS)
def test_monitor_lasts_as_long_as_requested(name: str, battery: dict[str, Any]) -> None:
    """A monitor may end earlier if it is killed, or if the handler of its condition is lost."""
    monitor, watch, properties = MONITORS[name]
    scenario = watched(watch, **battery)
    scenario.may_kill(monitor)
    assert_holds(scenario, eventually(has_ended(monitor)), *properties)


def sends_a_step(me: tca.Script) -> None:
    me.command(STEP)


def test_ended_monitor_acts_no_more() -> None:
    """The monitor is under a running task of another module."""
    scenario = watched(sends_a_step)
    scenario.module("legs").handles(STEP)(nothing)

    @scenario.module("watcher").does
    def watch(me: tca.Script) -> None:
        for step in me.tasks(STEP):
            me.under(step).monitor(BATTERY, period=1.0, maximum=1).end()

    scenario.may_kill(STEP)
    assert_holds(
        scenario,
        within(EVENTUALLY, accepted("end"), has_ended(BATTERY)),
        eventually(has_ended(STEP)),
    )


def test_monitor_ended_before_start_never_asks() -> None:
    scenario = watched(lambda me: [me.goal(WALK)])

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        task.monitor(BATTERY, period=1.0, maximum=1, constraints=[after_handler(task)]).end()

    scenario.may_kill(WALK)
    scenario.may_suspend(WALK)
    assert_holds(
        scenario, never(sent(IS_LOW)), within(EVENTUALLY, accepted("end"), has_ended(BATTERY))
    )


def test_accepted_fire_sends_the_action() -> None:
    def watch(me: tca.Script) -> None:
        rocks = me.monitor(ROCKS, maximum=2)
        assert rocks.fire(NOTE, "a rock") in (True, False)
        rocks.fire(NOTE, "another")

    scenario = watched(watch)
    scenario.may_kill(ROCKS)
    assert_holds(
        scenario,
        kept_at_once("fire", fired(NOTE)),
        within(EVENTUALLY, fired(NOTE), has_ended(NOTE)),
    )


# --- order and time -------------------------------------------------------------------------------


def two_steps(plan: Callable[[tca.Task], None], **legs: Any) -> tca.Scenario:
    """Return a scenario: a walk of two steps that could overlap. One of the steps is killed or
    lost.
    """
    scenario = tca.Scenario("two steps")
    scenario.module("planner").handles(WALK)(plan)
    scenario.module("legs", **legs).handles(STEP)(nothing)
    scenario.module("ear").handles(NOTE)(nothing)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.goal(WALK)

    if "may_be_lost" not in legs:
        scenario.may_kill(STEP)
    return scenario


def constrained(task: tca.Task) -> None:
    first = task.command(STEP, 1)
    second = task.command(STEP, 2, sequential=False, constraints=[after_handler(task)])
    task.constrain(first.achieving.end <= second.achieving.start)


def with_delay(task: tca.Task) -> None:
    first = task.command(STEP, 1)
    task.command(
        STEP, 2, sequential=False, constraints=[first.handling.end + 1.0 <= this.achieving.start]
    )


def with_priority(task: tca.Task) -> None:
    for number in (1, 2):
        task.command(
            STEP, number, sequential=False, priority=number, constraints=[after_handler(task)]
        )


def second_begun_or_killed(world: tca.World) -> bool:
    """Whether the second step has begun or was killed."""
    return any(step.is_begun or step.is_killed for step in messages_with(world, STEP, data=2))


@pytest.mark.parametrize("legs", [{"capacity": 2}, SOAKED_LOSS], ids=["two legs", "loss"])
def test_constraint_added_later_holds(legs: dict[str, Any]) -> None:
    assert_holds(two_steps(constrained, **legs), before(has_ended(STEP, 1), begun(STEP, 2)))


@pytest.mark.parametrize("legs", [{"capacity": 2}, SOAKED_LOSS], ids=["two legs", "loss"])
def test_delayed_step_starts_after_its_delay(legs: dict[str, Any]) -> None:
    assert_holds(
        two_steps(with_delay, **legs),
        within(
            1.0,
            has_ended(STEP, 1),
            lambda world: second_begun_or_killed(world) or not messages_with(world, STEP, data=2),
        ),
        eventually(has_ended(WALK)),
    )


@pytest.mark.parametrize("legs", [{}, SOAKED_LOSS], ids=["kill", "loss"])
def test_command_with_higher_priority_is_first(legs: dict[str, Any]) -> None:
    assert_holds(two_steps(with_priority, **legs), before(second_begun_or_killed, begun(STEP, 1)))


@pytest.mark.parametrize(
    ("legs", "ends", "word"),
    [
        ({}, killed(STEP), "killed"),
        pytest.param(LOST, failed(STEP), "failed", marks=pytest.mark.soak),
    ],
    ids=["kill", "loss"],
)
def test_wait_for_moment_returns_outcome_of_task(
    legs: dict[str, Any], ends: Any, word: str
) -> None:
    def plan(task: tca.Task) -> None:
        step = task.command(STEP, 1)
        task.inform(NOTE, str(step.wait_for(step.handling.end)))

    assert_holds(
        two_steps(plan, **legs),
        before(achieved(STEP), sent(NOTE, "done")),
        before(ends, sent(NOTE, word)),
        within(EVENTUALLY, accepted("wait_for"), sent(NOTE)),
    )


@pytest.mark.parametrize("legs", [{}, SOAKED_LOSS], ids=["kill", "loss"])
def test_retained_task_is_known_until_released(legs: dict[str, Any]) -> None:
    def plan(task: tca.Task) -> None:
        step = task.command(STEP, 1)
        step.keep()
        step.wait()
        task.inform(NOTE, step.info() is not None)
        step.release()
        task.inform(NOTE, step.info() is None)

    known = lambda world: sent(NOTE, True)(world) or has_ended(WALK)(world)  # noqa: E731
    assert_holds(
        two_steps(plan, **legs),
        never(sent(NOTE, False)),
        within(EVENTUALLY, accepted("keep"), known),
    )


# --- requests about a task, with the meaning of *kept* --------------------------------------------


class Request(NamedTuple):
    """A request about a step, with the condition under which the request counts as kept."""

    call: str
    ask: Callable[[Any, TaskRef], object]
    kept: Callable[[tca.World], object]
    seconds: float = 0
    """The time within which the request must be kept; 0: at once."""


def gone(world: tca.World) -> bool:
    """Whether every step has ended or was killed."""
    return all(one.is_killed or one.is_over for one in messages_with(world, STEP))


def ended_safely(world: tca.World) -> bool:
    """Whether the step ended or was killed before its start, or its termination message was handled
    before its end.
    """
    ended = messages_with(world, STEP, "is_over")
    return bool(messages_with(world, LIFT, "is_over")) or any(
        not (one.is_killed and one.is_begun) for one in ended
    )


def timed_out(world: tca.World) -> bool:
    return gone(world) or any(one.failure == "timeout" for one in messages_with(world, STEP))


def handled_again(world: tca.World) -> bool:
    return gone(world) or bool(messages_with(world, STEP, "is_handled", data="again"))


def is_held(world: tca.World) -> bool:
    return gone(world) or bool(messages_with(world, STEP, "is_suspended"))


def has_failed(world: tca.World) -> bool:
    return gone(world) or bool(messages_with(world, HELP) or messages_with(world, STEP, "failure"))


def suspend_and_resume(_: Any, step: TaskRef) -> None:
    step.suspend()
    step.resume()


def kill_descendants_of_parent(_: Any, step: TaskRef) -> None:
    if (walk := step.parent()) is not None:
        walk.kill(scope=Scope.DESCENDANTS)


REQUESTS = {
    "kill": Request("kill", lambda _, step: step.kill(), gone),
    "kill in 1 s": Request("kill", lambda _, step: step.kill(delay=1.0), gone, 1.0),
    "kill after its handling": Request(
        "kill", lambda _, step: step.kill(after=step.handling.end), gone, EVENTUALLY
    ),
    "kill of siblings": Request(
        "kill", lambda me, _: me.command(LIFT, sequential=False).kill(scope=Scope.SIBLINGS), gone
    ),
    "kill of all descendants of the parent": Request("kill", kill_descendants_of_parent, gone),
    "on termination": Request(
        "on_termination", lambda _, step: step.on_termination(LIFT), ended_safely, EVENTUALLY
    ),
    "deadline": Request("deadline", lambda _, step: step.deadline(5.0), timed_out, 5.0),
    "retry": Request("retry", lambda _, step: step.retry(STEP, "again"), handled_again, EVENTUALLY),
    "suspend": Request("suspend", suspend_and_resume, is_held),
    "resume": Request("resume", suspend_and_resume, gone, EVENTUALLY),
    "failure": Request(
        "fail", lambda _, step: step.fail(SLIPPED(text="seen from afar")), has_failed
    ),
}


@pytest.mark.parametrize(("name", "between"), one_in(6, REQUESTS, BETWEEN))
def test_accepted_request_about_task_is_kept(name: str, between: str) -> None:
    request = REQUESTS[name]
    ends_it = between in ("loss of client", "loss of server")
    is_timed = 0 < request.seconds < EVENTUALLY and not ends_it
    scenario = robot(name, request.ask, BETWEEN[between] + ", last" * is_timed)
    properties = [within(request.seconds, accepted(request.call), request.kept)]
    if not request.seconds:
        properties.append(kept_at_once(request.call, request.kept))
    assert_holds(scenario, *properties)


def killed_and_over(world: tca.World) -> list[tca.Seen]:
    return messages_with(world, STEP, "is_killed", "is_over")


def test_termination_message_is_handled_before_killed_task_ends() -> None:
    """The rule also holds if the kill came first, unknown to the handler."""
    scenario = tca.Scenario("a brake that was asked for is used")
    motor, brake, user = scenario.module("motor"), scenario.module("brake"), scenario.module("user")

    @motor.handles(STEP)
    def spin(task: tca.Task) -> None:
        task.ref.on_termination(LIFT)

    brake.handles(LIFT)(lambda _: None)

    @user.does
    def story(me: tca.Script) -> None:
        me.command(STEP).kill()

    assert_holds(scenario, before(begun(LIFT), killed_and_over))
