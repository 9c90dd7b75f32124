"""Plan: turn goals into commands."""

from tca_module import Module, Task, this

from messages import DRIVE, FILL, POUR, ROUND, WATER, Plant, Way

planner = Module("planner")


@planner.handles(ROUND)
def make_round(task: Task, plants: list[Plant]) -> None:
    with task.sequence(plan_ahead=1):
        for plant in plants:
            task.goal(WATER, plant)


@planner.handles(WATER)
def water(task: Task, plant: Plant) -> None:
    task.sleep(0.5)  # a real planner searches for a way here
    with task.parallel():
        drive = task.command(DRIVE, Way(plant.room))
        later = drive.handling.start + 0.3 <= this.handling.start
        task.command(FILL, plant.litres, constraints=[later])
    task.command(POUR, plant.litres)
    print("  planned:", plant.name)


if __name__ == "__main__":
    planner.run()
