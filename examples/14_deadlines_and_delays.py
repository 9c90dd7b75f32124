"""Time in constraints: not before, so long after, and no later than."""

import time

from tca_module import Command, Goal, Module, Task, TaskFailed

PHOTO, FLASH, CHARGE, DOCK = Goal("photo"), Command("flash"), Command("charge"), Command("dock")

robot, lamp = Module("robot"), Module("lamp")
began = time.monotonic()


def say(what: str, no_sooner_than: float) -> None:
    print(what, "in time" if time.monotonic() - began >= no_sooner_than else "too early")


@robot.handles(PHOTO)
def photo(task: Task) -> None:
    charge = task.command(CHARGE, delay=0.2)  # 0.2 s from now
    flash = task.command(FLASH)
    task.constrain(charge.achieving.end + 0.3 <= flash.achieving.start)  # the lamp warms up


@lamp.handles(CHARGE)
def charge(_: Task) -> None:
    say("charged", 0.2)


@lamp.handles(FLASH)
def flash(_: Task) -> None:
    say("flashed", 0.5)


@lamp.handles(DOCK)
def dock(task: Task) -> None:
    while not task.cancelled:  # it does not find the dock
        time.sleep(0.01)


if __name__ == "__main__":
    with robot.running(), lamp.running():
        robot.goal(PHOTO).wait(timeout=10)
        docking = robot.command(DOCK, deadline=0.2)  # or the failure "timeout" is raised on it
        try:
            docking.result(timeout=10)
        except TaskFailed as failed:
            print(failed.failure, failed.text)
