"""Act: drive, fill the can and pour."""

from tca_module import Module, Task

from messages import BLOCKED, DRIVE, FILL, POUR, Way

body = Module("body")
can = body.resource("can")


@body.handles(DRIVE)
def drive(task: Task, way: Way) -> None:
    task.sleep(1.0)
    if way == Way("study", through="hall"):  # a real robot asks its bumper here
        print("the hall is blocked")
        raise BLOCKED(way)
    print("in the", way.room, "through the", way.through)


@body.handles(FILL, resource=can)
def fill(task: Task, litres: float) -> None:
    task.sleep(0.4)
    print("filled in", litres, "litres")


@body.handles(POUR, resource=can)
def pour(task: Task, litres: float) -> None:
    task.sleep(0.5)
    print("poured", litres, "litres")


if __name__ == "__main__":
    body.run()
