"""Small scenarios for several test files: walks with failures, wiretaps and monitors."""

from typing import Any

from dev.invariants import check_invariants
from tca_module import Recovery
from tca_tools.explore import Property, Result, Scenario, Script, Task, explore, report
from tca_wire.messages.controls import ExceptionHandler, PollingMonitor
from tca_wire.messages.declarations import Command, Failure, Goal, Inform, MultiQuery, Query
from tca_wire.vocabulary import Condition

WALK: Goal[Any] = Goal("walk", Any)
REST: Goal[Any] = Goal("rest", Any)
STEP: Command[Any, Any] = Command("step", Any, result=Any)
LIFT: Command[Any, Any] = Command("lift", Any)
WHERE: Query[Any, Any] = Query("where", reply=int)
HEIGHTS: MultiQuery[Any, Any] = MultiQuery("heights", reply=int)
NOTE: Inform[Any] = Inform("note", Any)
SLIPPED = Failure("slipped")
HIGHER, REPLAN = ExceptionHandler("higher"), ExceptionHandler("replan")
CHECK: Command[Any, None] = Command("check", Any)
IS_LOW: Query[Any, Any] = Query("is the battery low", reply=bool)
RECHARGE = Command("recharge")
BATTERY = PollingMonitor("battery", condition=IS_LOW, action=RECHARGE)
GAUGE = PollingMonitor("gauge", condition=IS_LOW)


def assert_good(scenario: Scenario, *properties: Property, **options: Any) -> Result:
    """Assert that all properties hold in all runs."""
    result = explore(scenario, *properties, check=check_invariants, **options)
    assert result.ok, report(result)
    return result


def counterexample(scenario: Scenario, *properties: Property, **options: Any) -> str:
    """Explore a scenario, assert that a property is violated, and return the counterexample as
    text.
    """
    result = explore(scenario, *properties, check=check_invariants, **options)
    assert result.violation is not None, report(result)
    return report(result)


def walking(*properties: Property, steps: int = 2, slips: bool = False, **legs: Any) -> Scenario:
    """Return a scenario: a user walks and then rests. Only the first two steps of a walk are
    ordered.
    """
    scenario = Scenario("walking", *properties)
    planner, feet, user = (
        scenario.module("planner"),
        scenario.module("legs", **legs),
        scenario.module("user"),
    )

    @planner.handles(WALK)
    def walk(task: Task) -> None:
        for number in range(steps):
            task.command(STEP, number, sequential=number == 1)

    @planner.handles(REST)
    def rest(_: Task) -> None: ...

    @feet.handles(STEP)
    def step(task: Task) -> None:
        if slips and task.choose("holds", "slips") == "slips":
            raise SLIPPED(text="ice")

    @user.does
    def story(me: Script) -> None:
        me.goal(WALK)
        me.goal(REST).wait()

    return scenario


def ladder(*properties: Property, retries: int = 1, gives_up: bool = True) -> Scenario:
    """Return a scenario with a step that may slip each time. One exception handler retries the
    step. The next one replans the walk, and later gives up.
    """
    scenario = Scenario("a recovery ladder", *properties)
    planner, expert = scenario.module("planner"), scenario.module("expert")
    scenario.module("legs").handles(STEP)(slips_or_not)

    @planner.handles(WALK)
    def walk(task: Task, way: str) -> None:
        task.command(STEP, way)

    @expert.handles(HIGHER)
    def higher(task: Task) -> None:
        trouble = task.trouble
        if trouble.attempts > retries:
            raise trouble.reissue()
        trouble.failing.retry(STEP, "higher")

    @expert.handles(REPLAN)
    def replan(task: Task) -> None:
        trouble = task.trouble
        assert trouble.attached is not None
        if gives_up and trouble.invocations > 1:
            raise trouble.reissue()
        trouble.attached.retry(WALK, "another way")

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.on_failure(SLIPPED, HIGHER, of=STEP)
        me.goal(WALK, "straight", on_failure=[Recovery(SLIPPED, REPLAN)]).wait()

    return scenario


def tapped(condition: Condition, *properties: Property) -> Scenario:
    """Return a scenario in which a wiretap checks each of two steps."""
    scenario = Scenario(f"tapped {condition}", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("safety").handles(CHECK)(lambda _: None)

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.tap(condition, STEP, CHECK)
        me.command(STEP, 1)
        me.command(STEP, 2).wait()

    return scenario


def tapped_late(*properties: Property, safety_arrives_late: bool = False) -> Scenario:
    """Return a scenario with a wiretap on a step that is queued for a locked resource. The user
    adds the tap, or the safety module does when it arrives late.
    """
    scenario = Scenario("tapped late", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)
    safety = scenario.module("safety", arrives_late=safety_arrives_late)
    safety.handles(CHECK)(lambda _: None)
    if safety_arrives_late:
        safety.at_start(lambda module: module.tap(Condition.BEFORE_HANDLING, STEP, CHECK))

    @scenario.module("user").does
    def story(me: Script) -> None:
        with me.lock("legs"):
            me.command(STEP, 1)
            if safety_arrives_late:
                me.wait_until_handled(CHECK)
            else:
                me.tap(Condition.BEFORE_HANDLING, STEP, CHECK)

    return scenario


def suspending(*properties: Property) -> Scenario:
    """Return a scenario with a walk that may be suspended, and is then resumed."""
    scenario = Scenario("suspended", *properties)

    scenario.module("planner").handles(WALK)(steps_once)
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK)
        me.goal(REST).wait()

    scenario.module("couch").handles(REST)(lambda _: None)
    scenario.may_suspend(WALK)
    return scenario


def ordered(*properties: Property, suspended: bool, kills: int = 0) -> Scenario:
    """Return a scenario: two steps are created and then ordered, the newer one first. *kills* of
    these steps may be killed.
    """
    scenario = Scenario("ordered", *properties)
    scenario.module("legs", capacity=2).handles(STEP)(nothing)
    scenario.may_kill(STEP, kills)

    @scenario.module("planner").handles(WALK)
    def walk(task: Task) -> None:
        first, second = (
            task.command(STEP, one, sequential=False, suspended=suspended) for one in (1, 2)
        )
        task.constrain(second.achieving.end <= first.achieving.start)
        if suspended:
            first.resume()
            second.resume()

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK)

    return scenario


def late(*properties: Property, handled: bool = False) -> Scenario:
    """Return a scenario with a step whose deadline is five seconds. The step's reply may be under
    way when the deadline passes.
    """
    scenario = Scenario("a deadline", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)
    expert = scenario.module("expert")
    expert.handles(HIGHER)(resolves)

    @expert.handles(REPLAN)
    def replan(task: Task) -> None:
        task.trouble.failing.retry()

    @scenario.module("user").does
    def story(me: Script) -> None:
        if handled:
            me.on_failure(None, me.choose(HIGHER, REPLAN), of=STEP)
        me.command(STEP, deadline=5.0)
        me.goal(REST).wait()

    scenario.module("couch").handles(REST)(lambda _: None)
    return scenario


def polling(monitor: PollingMonitor[None], *properties: Property, **options: Any) -> Scenario:
    """Return a scenario with a monitor that asks every second whether the battery is low."""
    scenario = Scenario("polling", *properties)

    @scenario.module("battery").handles(IS_LOW)
    def is_low(task: Task) -> bool:
        return task.choose(False, True)

    scenario.module("dock").handles(RECHARGE)(lambda _: None)

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.monitor(monitor, period=1.0, **options)

    return scenario


def helped(*properties: Property, may_leave: bool = False) -> Scenario:
    """Return a scenario in which two steps slip. A helper handles one failure at a time, and may be
    lost. A second exception handler stands by.
    """
    scenario = Scenario("two steps slip", *properties)
    scenario.module("legs", capacity=2).handles(STEP)(slips)
    scenario.module("helper", may_be_lost=1, may_leave=may_leave).handles(HIGHER)(resolves)
    scenario.module("office").handles(REPLAN)(resolves)

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.on_failure(SLIPPED, REPLAN, of=STEP)
        me.on_failure(SLIPPED, HIGHER, of=STEP)
        for one in [me.command(STEP, sequential=False) for _ in range(2)]:
            one.wait()

    return scenario


def resolves(task: Task) -> None:
    """Resolve every failure."""
    task.trouble.resolved()


def slips(_: object) -> None:
    """Fail each time."""
    raise SLIPPED(text="ice")


def slips_or_not(task: Task) -> None:
    if task.choose("holds", "slips") == "slips":
        raise SLIPPED(text="ice")


def nothing(*_: object) -> None:
    """Do nothing, as a handler."""


def steps_once(task: Task) -> None:
    task.command(STEP)
