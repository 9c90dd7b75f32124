"""Plan: turn goals into commands."""

from tca_module import Module, Task

from messages import DRIVE, POUR, WATER, Plant, Way

planner = Module("planner")


@planner.handles(WATER)
def water(task: Task, plant: Plant) -> None:
    task.command(DRIVE, Way(plant.room))
    task.command(POUR, plant.litres)


if __name__ == "__main__":
    planner.run()
