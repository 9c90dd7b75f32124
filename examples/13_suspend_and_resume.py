"""Suspend and resume a walk: the running step finishes, the next step starts after the resume."""

import threading
import time

from tca_module import Command, Goal, Module, Task

WALK, STEP = Goal("walk", int), Command("step", int)

planner, legs = Module("planner"), Module("legs")
stepping = threading.Event()


@planner.handles(WALK)
def walk(task: Task, steps: int) -> None:
    for number in range(1, steps + 1):
        task.command(STEP, number)


@legs.handles(STEP)
def step(task: Task, number: int) -> None:
    stepping.set()
    while number == 1 and not task.suspended:  # the step takes until the suspension
        time.sleep(0.01)
    print(f"step {number}{', while suspended' if task.suspended else ''}")


if __name__ == "__main__":
    with planner.running(), legs.running():
        walking = planner.goal(WALK, 3)
        stepping.wait(10)
        walking.wait_for(walking.handling.end)  # all steps have been sent
        first, second, _ = walking.children(STEP)
        walking.suspend()
        walking.wait_for(first.achieving.end, timeout=10)
        info = second.info()
        print("the second is", "held" if info and info.suspended and not info.module else "lost")
        walking.resume()
        print("the walk is", walking.wait(timeout=10))
