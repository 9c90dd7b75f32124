"""The battery layer: when the battery runs low, collecting is suspended, the robot recharges, and
collecting is resumed.

A cup in the hand stays there in the meantime. A goal that has begun is retried afterwards, and
planned again for the new situation. A robot that does not reach the charger waits and tries again.
If all tries fail, the shift ends.
"""

from robots.office_sim.messages import (
    BATTERY,
    CHARGE,
    COLLECT_CUP,
    FLOOR_PLAN,
    FOLLOW_PATH,
    HELD_CUP,
    KEEP_FLOOR_FREE,
    NAVIGATE,
    NEW_CUPS,
)
from robots.office_sim.program import run
from robots.office_sim.vocabulary import Approach
from tca_module import (
    Command,
    Condition,
    ExceptionHandler,
    Failure,
    Module,
    PollingMonitor,
    Query,
    Task,
    TaskRef,
)

PERIOD = 2.0
"""Seconds between two checks of the battery."""

LOW = 0.3
"""The charge at which to recharge: enough to reach the charger from anywhere, after all waits."""

TRIES, WAIT = 5, 30.0
"""How often the robot tries to charge, and the seconds between two tries."""

IS_LOW = Query("is battery low", reply=bool)
RECHARGE = Command("recharge")
BATTERY_LOW = PollingMonitor("battery low", condition=IS_LOW, action=RECHARGE)
CHARGE_LATER = ExceptionHandler("charge later")
NOT_CHARGED = Failure("not charged")


def make_module(pace: float) -> Module:
    """Make the layer's module."""
    layer = Module("battery layer")
    layer.resource("recharging")

    @layer.at_start
    def attach(module: Module) -> None:
        module.tap(Condition.WHILE_ACHIEVING, KEEP_FLOOR_FREE, BATTERY_LOW, period=PERIOD / pace)
        module.on_failure(None, CHARGE_LATER, of=RECHARGE, maximum=TRIES)

    @layer.handles(IS_LOW)
    def is_low(task: Task) -> bool:
        return task.query(BATTERY) < LOW and not task.tasks(RECHARGE)

    @layer.handles(RECHARGE, resource="recharging")
    def recharge(task: Task) -> None:
        collecting = task.tasks(NEW_CUPS)  # and all goals under it
        for monitor in collecting:
            monitor.suspend()
        try:
            task.query(HELD_CUP)  # the arm answers when it is at rest
            for goal in task.tasks(COLLECT_CUP):
                _interrupt(goal)
            task.goal(NAVIGATE, Approach(task.query(FLOOR_PLAN).charger))
            task.command(CHARGE).wait()
        finally:
            with task.shielded():
                for monitor in collecting:
                    monitor.resume()

    @layer.handles(CHARGE_LATER)
    def charge_later(task: Task) -> None:
        """Wait and retry: the obstacle on the way to the charger may disappear."""
        trouble = task.trouble
        assert trouble.attached is not None
        if trouble.invocations >= TRIES:
            raise NOT_CHARGED(
                None, f"the battery could not be charged in {TRIES} tries: {trouble.text}"
            )
        task.sleep(WAIT / pace)
        trouble.attached.retry()

    return layer


def _interrupt(goal: TaskRef) -> None:
    """Retry a goal that has begun, and wait until the base is at rest. While collecting is
    suspended, the goal does not start again.
    """
    driving = goal.descendants(FOLLOW_PATH)
    info = goal.info()
    if info is not None and "start achieving" in info.reached:
        goal.retry()
        for drive in driving:
            drive.wait()


if __name__ == "__main__":
    run(make_module)
