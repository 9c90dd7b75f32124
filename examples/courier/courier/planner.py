"""Plan deliveries. A drive that is blocked is tried again after ten seconds, at most twice."""

from courier.messages import (
    BLOCKED,
    CHARGE,
    DELIVER,
    DRIVE,
    GRASP,
    PUT_DOWN,
    ROUTE,
    TOO_WEAK,
    TRY_AGAIN,
    Parcel,
    Trip,
)
from tca_module import Module, Task

HOME, LEAST_CHARGE, PAUSE = "hall", 0.2, 10.0
planner = Module("planner", requires=[ROUTE, CHARGE, DRIVE, GRASP, PUT_DOWN])
planner.at_start(lambda module: module.on_failure(BLOCKED, TRY_AGAIN, of=DRIVE, maximum=2))


@planner.handles(DELIVER)
def deliver(task: Task, parcel: Parcel) -> None:
    if (charge := task.query(CHARGE)) < LEAST_CHARGE:
        raise TOO_WEAK(charge)
    to_parcel = task.query(ROUTE, Trip(HOME, parcel.trip.start))
    with_parcel = task.query(ROUTE, parcel.trip)
    with task.sequence():
        for room in to_parcel:
            task.command(DRIVE, room)
        task.command(GRASP, parcel.name)
        for room in with_parcel:
            task.command(DRIVE, room)
        task.command(PUT_DOWN, parcel.name)


@planner.handles(TRY_AGAIN)
def try_again(task: Task) -> None:
    task.sleep(PAUSE)
    task.trouble.failing.retry()


if __name__ == "__main__":
    planner.run()
