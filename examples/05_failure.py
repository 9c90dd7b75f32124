"""A failure without an exception handler ends the top-level task. The error names the cause."""

from tca_module import Command, Failure, Goal, Module, Task, TaskFailed

WALK, LIFT, STEP = Goal("walk"), Command("lift leg", int), Command("step", int)
COLLISION = Failure("terrain collision", float)

legs = Module("legs")


@legs.handles(WALK)
def walk(task: Task) -> None:
    with task.sequence():
        for leg in range(3):
            task.command(LIFT, leg)
            task.command(STEP, leg)


@legs.handles(LIFT)
def lift(_: Task, leg: int) -> None:
    print("lift", leg)


@legs.handles(STEP)
def step(_: Task, leg: int) -> None:
    if leg == 1:
        raise COLLISION(812.5, "leg 1 met a rock")
    print("step", leg)


if __name__ == "__main__":
    with legs.running():
        try:
            legs.goal(WALK).result()
        except TaskFailed as error:
            print("failed:", error)
