"""A script whose goals end with it: on_leave="cancel" also holds when the script dies."""

from tca_module import Goal, Module, Task, connect

DRIVE = Goal("drive", str, progress=str)

wheels = Module("wheels")


@wheels.handles(DRIVE)
def drive(task: Task, place: str) -> None:
    """Drive until the task is cancelled, and stop the motors."""
    print("drives to", place)
    task.report("on the way")
    try:
        task.sleep(60)
    finally:
        print("motors off")


def main() -> None:
    with wheels.running(), connect("operator", on_leave="cancel") as operator:
        trip = operator.goal(DRIVE, "dock")
        next(trip.progress(str))
        print("the operator leaves")


if __name__ == "__main__":
    main()
