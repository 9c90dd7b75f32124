"""Water a plant: drive to it, then pour."""

from tca_module import Command, Goal, Module, Task

WATER = Goal("water", str)  # a plant
DRIVE = Command("drive", str)  # to a plant
POUR = Command("pour", float)  # litres
robot = Module("robot")


@robot.handles(WATER)
def water(task: Task, plant: str) -> None:
    task.command(DRIVE, plant)
    task.command(POUR, 0.5)
    print("planned:", plant)


@robot.handles(DRIVE)
def drive(task: Task, plant: str) -> None:
    task.sleep(1.0)  # a real robot turns its wheels here
    print("at the", plant)


@robot.handles(POUR)
def pour(task: Task, litres: float) -> None:
    task.sleep(0.5)  # a real robot opens a valve here
    print("poured", litres, "litres")


if __name__ == "__main__":
    with robot.running():
        watering = robot.goal(WATER, "fern")
        watering.result()
        print("done:", watering)
