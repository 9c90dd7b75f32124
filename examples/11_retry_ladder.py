"""Three recoveries in turn: lift the leg higher, try another foothold, then go round the rocks.

``maximum=`` limits the calls of an exception handler for one task. After that, central calls the
next exception handler above.
"""

from tca_module import Command, ExceptionHandler, Failure, Goal, Module, Task

STEP, MOVE_LEG, TURN = Goal("take a step", int), Command("move leg", float), Command("turn")
COLLISION = Failure("terrain collision", float)  # the height of the leg
RAISE_LEG, REPLAN = ExceptionHandler("raise the leg", float), ExceptionHandler("replan")
GO_ROUND = ExceptionHandler("go round")

planner, legs, expert = Module("planner"), Module("legs"), Module("expert")


@planner.handles(STEP)
def step(task: Task, foothold: int) -> None:
    print(f"step to foothold {foothold}")
    task.command(MOVE_LEG, 0.1)


@legs.handles(MOVE_LEG)
def move_leg(_: Task, height: float) -> None:
    print(f"  at {height:.1f}: collision")
    raise COLLISION(height)


@legs.handles(TURN)
def turn(_: Task) -> None:
    print("  turned away from the rocks")


@expert.handles(RAISE_LEG)
def raise_leg(task: Task, height: float) -> None:
    task.trouble.failing.retry(MOVE_LEG, height + 0.1)


@expert.handles(REPLAN)
def replan(task: Task) -> None:
    above = task.trouble.attached
    assert above is not None
    above.retry(STEP, above.data(STEP) + 1)


@expert.handles(GO_ROUND)
def go_round(task: Task) -> None:
    task.command(TURN)
    # The turn replaces the move. The failure counts as resolved once the turn is done.
    task.trouble.resolved()


if __name__ == "__main__":
    with planner.running(), legs.running(), expert.running():
        planner.on_failure(COLLISION, GO_ROUND, of=STEP)  # called after REPLAN: newer goes first
        planner.on_failure(COLLISION, RAISE_LEG, of=MOVE_LEG, maximum=2)
        planner.on_failure(COLLISION, REPLAN, of=STEP, maximum=1)
        print("the step is", planner.goal(STEP, 1).wait(timeout=10))
