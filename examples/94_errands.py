"""A robot that runs errands, slow enough to be watched and steered from another terminal.

Start ``tca central`` and this file. Then try ``tca status``, ``tca suspend fetch``, ``tca tree``.
"""

import sys

from tca_module import Command, Goal, Module, Task

FETCH, DRIVE, GRASP = Goal("fetch", str), Command("drive", str), Command("grasp", str)
SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 0.1
robot = Module("robot")


@robot.handles(FETCH, resource="planner")
def fetch(task: Task, thing: str) -> None:
    with task.sequence():
        task.command(DRIVE, "kitchen")
        task.command(GRASP, thing)
        task.command(DRIVE, "home")


@robot.handles(DRIVE, resource="body")
@robot.handles(GRASP, resource="body")
def act(task: Task, what: str) -> None:
    task.sleep(SECONDS)
    print(task.message, what)


if __name__ == "__main__":
    with robot.running():
        robot.goal(FETCH, "cup")
        robot.goal(FETCH, "plate").wait()
