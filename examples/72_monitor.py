"""A polling monitor asks about the battery while a rover explores, and has it charged in time."""

from itertools import count

from tca_module import Command, Goal, Module, PollingMonitor, Query, Task

EXPLORE, DRIVE, CHARGE = Goal("explore"), Command("drive"), Command("charge")
IS_LOW = Query("is the battery low", reply=bool)
BATTERY = PollingMonitor("battery", condition=IS_LOW, action=CHARGE)

rover, battery = Module("rover"), Module("battery")
levels = count(50, -10)  # in percent: 50, 40, 30, 20, ...


@rover.handles(EXPLORE)
def explore(task: Task) -> None:
    # Asks IS_LOW every 0.05 s, and sends CHARGE once.
    task.monitor(BATTERY, period=0.05, maximum=1)
    task.command(DRIVE)


@rover.handles(DRIVE, resource="wheels")
def drive(task: Task) -> None:
    print("drives")
    task.sleep(0.4)
    print("has arrived")


@battery.handles(IS_LOW)
def is_low(_: Task) -> bool:
    return next(levels) <= 20


@battery.handles(CHARGE)
def charge(_: Task) -> None:
    print("charges")


if __name__ == "__main__":
    with rover.running(), battery.running():
        print("explored:", rover.goal(EXPLORE).wait(timeout=10))
