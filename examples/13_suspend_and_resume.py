"""Suspend and resume a walk: the running step finishes, the next step starts after the resume."""

from tca_module import Command, Goal, Module, Task, connect

WALK, STEP = Goal("walk", int), Command("step", int)

planner, legs = Module("planner"), Module("legs")


@planner.handles(WALK)
def walk(task: Task, steps: int) -> None:
    for number in range(1, steps + 1):
        task.command(STEP, number)


@legs.handles(STEP)
def step(task: Task, number: int) -> None:
    print("step", number)
    while number == 1 and not task.suspended:  # the first step lasts until the suspension
        task.sleep(0.01)
    print("end of step", number)


if __name__ == "__main__":
    with planner.running(), legs.running(), connect("operator") as operator:
        walking = operator.goal(WALK, 2)
        walking.wait_for(walking.handling.end)  # all steps have been sent
        first, second = walking.children(STEP)
        first.wait_for_state("running", timeout=10)
        walking.suspend()
        first.wait(timeout=10)
        print("while suspended, step 2 is", second.state)
        walking.resume()
        print("the walk is", walking.wait(timeout=10))
