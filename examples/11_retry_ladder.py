"""One recovery after the other: try again, higher each time; then another plan; then give up, and the user is told.

Each exception handler says how often it may be called for one task; when that is used up, the next one above is.
"""

from tca_module import Command, ExceptionHandler, Failure, Goal, Module, Task, TaskFailed

STEP, MOVE_LEG = Goal("take a step", int), Command("move leg", float)
COLLISION = Failure("terrain collision", float)  # at which height
RAISE_LEG, REPLAN = ExceptionHandler("raise the leg", float), ExceptionHandler("replan")

planner, legs, expert = Module("planner"), Module("legs"), Module("expert")


@planner.handles(STEP)
def step(task: Task, foothold: int) -> None:
    print(f"step to foothold {foothold}")
    task.command(MOVE_LEG, 0.1)


@legs.handles(MOVE_LEG)
def move_leg(_: Task, height: float) -> None:
    print(f"  at {height:.1f}: collision")
    raise COLLISION(height)


@expert.handles(RAISE_LEG)
def raise_leg(task: Task, height: float) -> None:
    task.trouble.failing.retry(MOVE_LEG, height + 0.1)


@expert.handles(REPLAN)
def replan(task: Task) -> None:
    above = task.trouble.attached
    assert above is not None
    above.retry(STEP, above.data(STEP) + 1)


if __name__ == "__main__":
    with planner.running(), legs.running(), expert.running():
        planner.on_failure(COLLISION, RAISE_LEG, of=MOVE_LEG, maximum=2)
        planner.on_failure(COLLISION, REPLAN, of=STEP, maximum=1)
        try:
            planner.goal(STEP, 1).result(timeout=10)
        except TaskFailed as failed:
            print("given up:", failed.failure)
