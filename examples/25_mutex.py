"""Let one task at a time use a thing that no handler guards: a resource without handlers."""

from tca_module import Command, Module, Task, connect

DRAW = Command("draw", str)
ERASE = Command("erase", str)

robot, pen_holder = Module("robot"), Module("pen holder")
pen_holder.resource("pen")  # without a handler, it is only locked
robot.resource("robot", capacity=2)


def use_pen(task: Task, what: str) -> None:
    with task.lock("pen"):
        print("took the pen to", what)
        task.sleep(0.05)
        print("put the pen back")


@robot.handles(DRAW)
def draw(task: Task, what: str) -> None:
    use_pen(task, f"draw a {what}")


@robot.handles(ERASE)
def erase(task: Task, what: str) -> None:
    use_pen(task, f"erase a {what}")


if __name__ == "__main__":
    with pen_holder.running(), robot.running(), connect("user") as user:
        drawing = user.command(DRAW, "circle")
        erasing = user.execute_if_handled(ERASE, "line", sequential=False)
        drawing.wait(timeout=10)
        if erasing is not None:
            erasing.wait(timeout=10)
