"""Wait for a busy resource: the highest priority goes first, and of poses only the newest waits."""

import threading

from tca_module import Command, Inform, Module, Task

SHOW, POSE = Command("show", str), Inform("pose", int)

display, user = Module("display"), Module("user")
busy, go_on = threading.Event(), threading.Event()


@display.handles(SHOW)
def show(_: Task, what: str) -> None:
    busy.set()
    go_on.wait(10)
    print(what)


@display.handles(POSE, pending=1)
def pose(_: Task, x: int) -> None:
    print("pose", x)


if __name__ == "__main__":
    with display.running(), user.running():
        user.command(SHOW, "a picture", sequential=False)
        busy.wait(10)
        for x in range(100):
            user.inform(POSE, x)
        last = user.command(SHOW, "the weather", sequential=False)
        user.command(SHOW, "a warning", sequential=False, priority=10)
        user.modules()  # a question: when it is answered, central has all that was sent before
        go_on.set()
        last.wait(timeout=10)
