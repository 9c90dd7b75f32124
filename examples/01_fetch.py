"""A goal that expands into commands, done one after the other.

Start ``tca central`` in one terminal and this in another; ``tca tree`` then draws what happened.
"""

from tca_module import Command, Goal, Module, Task

FETCH, DRIVE, GRASP = Goal("fetch", str), Command("drive", str), Command("grasp", str)
robot = Module("robot")


@robot.handles(FETCH)
def fetch(task: Task, thing: str) -> None:
    with task.sequence():
        task.command(DRIVE, "kitchen")
        task.command(GRASP, thing)
        task.command(DRIVE, "home")


@robot.handles(DRIVE)
@robot.handles(GRASP)
def act(task: Task, what: str) -> None:
    print(task.message, what)


if __name__ == "__main__":
    with robot.running():
        robot.goal(FETCH, "cup").wait()
