"""Act: drive and pour."""

from tca_module import Module, Task

from messages import DRIVE, POUR, Way

body = Module("body")


@body.handles(DRIVE)
def drive(task: Task, way: Way) -> None:
    task.sleep(1.0)
    print("in the", way.room)


@body.handles(POUR)
def pour(task: Task, litres: float) -> None:
    task.sleep(0.5)
    print("poured", litres, "litres")


if __name__ == "__main__":
    body.run()
