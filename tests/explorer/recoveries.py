"""Small scenarios of what goes wrong and is watched over: failures, wiretaps, monitors, suspension, deadlines."""

from typing import Any

from explorer.scenarios import REST, SLIPPED, STEP, WALK

from tca_explorer import Property, Scenario, Script, Task
from tca_wire.messages.controls import ExceptionHandler, PollingMonitor
from tca_wire.messages.declarations import Command, Query
from tca_wire.vocabulary import Condition

HIGHER, REPLAN = ExceptionHandler("higher"), ExceptionHandler("replan")
CHECK: Command[Any, None] = Command("check", Any)
IS_LOW: Query[Any, Any] = Query("is the battery low", reply=bool)
RECHARGE = Command("recharge")
BATTERY = PollingMonitor("battery", condition=IS_LOW, action=RECHARGE)
GAUGE = PollingMonitor("gauge", condition=IS_LOW)


def ladder(*properties: Property, retries: int = 1, gives_up: bool = True) -> Scenario:
    """A step that may slip each time; it is retried, then the walk is planned anew, then somebody gives up."""
    scenario = Scenario("a recovery ladder", *properties)
    planner, feet, expert = (scenario.module(name) for name in ("planner", "legs", "expert"))

    @planner.handles(WALK)
    def walk(task: Task, way: str) -> None:
        task.command(STEP, way)

    @feet.handles(STEP)
    def step(task: Task) -> None:
        if task.choose("holds", "slips") == "slips":
            raise SLIPPED(text="ice")

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
        me.goal(WALK, "straight", on_failure=[(SLIPPED, REPLAN)]).wait()

    return scenario


def tapped(condition: Condition, *properties: Property) -> Scenario:
    """Somebody checks each of two steps."""
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
    """A step that waits outside of locked legs is checked: somebody taps it, or the checks come with their module."""
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
    """A walk that somebody may suspend, and that is resumed."""
    scenario = Scenario("suspended", *properties)

    @scenario.module("planner").handles(WALK)
    def walk(task: Task) -> None:
        task.command(STEP, 1)
        task.command(STEP, 2)

    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK)
        me.goal(REST).wait()

    scenario.module("couch").handles(REST)(lambda _: None)
    scenario.may_suspend(WALK)
    return scenario


def late(*properties: Property, handled: bool = False) -> Scenario:
    """A step that must be done in five seconds, and whose reply may be under way when they are over."""
    scenario = Scenario("a deadline", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)
    expert = scenario.module("expert")
    expert.handles(HIGHER)(lambda _: None)

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
    """A monitor that asks every second whether the battery is low."""
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
    """Two steps slip; a helper that may go comes to one at a time, and who stands by makes up for what it can't do."""
    scenario = Scenario("two steps slip", *properties)
    scenario.module("legs", capacity=2).handles(STEP)(slips)
    scenario.module("helper", may_be_lost=1, may_leave=may_leave).handles(HIGHER)(lambda _: None)
    scenario.module("office").handles(REPLAN)(lambda _: None)

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.on_failure(SLIPPED, REPLAN, of=STEP)
        me.on_failure(SLIPPED, HIGHER, of=STEP)
        for one in [me.command(STEP, sequential=False) for _ in range(2)]:
            one.wait()

    return scenario


def slips(_: Task) -> None:
    """Each time."""
    raise SLIPPED(text="ice")
