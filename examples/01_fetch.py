"""A goal expands into commands that are done one after the other. A second goal fails.

Start ``tca central`` in one terminal and this file in another. ``tca tree`` then draws the tasks.
"""

from tca_module import Command, Failure, Goal, Module, Task, TaskFailed

FETCH, DRIVE, GRASP = Goal("fetch", str), Command("drive", str), Command("grasp", str)
TOO_HEAVY = Failure("too heavy", str)
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
    if what == "piano":
        raise TOO_HEAVY(what)


if __name__ == "__main__":
    with robot.running():
        robot.goal(FETCH, "cup").result()
        try:
            robot.goal(FETCH, "piano").result()
        except TaskFailed as failed:
            print(failed)
