"""Queue for a busy resource: the highest priority goes first; only the newest pose is kept."""

import threading

from tca_module import Command, Inform, Module, Task

SHOW, POSE = Command("show", str), Inform("pose", int)

display, user = Module("display"), Module("user")
busy, may_finish = threading.Event(), threading.Event()


@display.handles(SHOW)
def show(_: Task, content: str) -> None:
    busy.set()
    may_finish.wait(10)
    print(content)


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
        user.modules()  # the answer shows that central has received all messages above
        may_finish.set()
        last.wait(timeout=10)
