"""Drive from room to room."""

from courier.messages import CONSUMED, DRIVE
from tca_module import Module, Task

METRES, SPEED, PART = 5.0, 50.0, 0.02  # of one drive; a fast robot: the example is for tests
wheels = Module("wheels")


@wheels.handles(DRIVE)
def drive(task: Task, room: str) -> float:
    task.sleep(METRES / SPEED)
    task.inform(CONSUMED, PART)
    print("in the", room)
    return METRES


if __name__ == "__main__":
    wheels.run()
