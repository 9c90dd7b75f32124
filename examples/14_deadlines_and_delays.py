"""Delays and deadlines: start after a delay, wait after another task, end before a deadline."""

import time

from tca_module import Command, Goal, Module, Task, TaskFailed

PHOTO, FLASH, CHARGE, DOCK = Goal("photo"), Command("flash"), Command("charge"), Command("dock")

robot, lamp = Module("robot"), Module("lamp")
started = time.monotonic()


def print_timing(action: str, earliest: float) -> None:
    print(action, "in time" if time.monotonic() - started >= earliest else "too early")


@robot.handles(PHOTO)
def photo(task: Task) -> None:
    charge = task.command(CHARGE, delay=0.2)  # 0.2 s from now
    flash = task.command(FLASH)
    task.constrain(charge.achieving.end + 0.3 <= flash.achieving.start)  # the lamp warms up


@lamp.handles(CHARGE)
def charge(_: Task) -> None:
    print_timing("charged", 0.2)


@lamp.handles(FLASH)
def flash(_: Task) -> None:
    print_timing("flashed", 0.5)


@lamp.handles(DOCK)
def dock(task: Task) -> None:
    while not task.cancelled:  # search for the dock in vain
        time.sleep(0.01)


if __name__ == "__main__":
    with robot.running(), lamp.running():
        robot.goal(PHOTO).wait(timeout=10)
        docking = robot.command(DOCK, deadline=0.2)  # later: failure "timeout"
        try:
            docking.result(timeout=10)
        except TaskFailed as failed:
            print(failed.failure, failed.text)
