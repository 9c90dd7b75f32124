"""Limit a queue: only the newest picture waits, a warning comes first, and the sender is told."""

import threading

from tca_module import Command, Module, Query, QueryFailed, Task

SHOW, COUNT = Command("show", str), Query("count people", int, reply=int)

display = Module("display")
busy, may_finish = threading.Event(), threading.Event()


@display.handles(SHOW)
def show(_: Task, content: str) -> None:
    print("shows", content)
    busy.set()
    may_finish.wait(10)


@display.handles(COUNT, pending=1)  # a newer picture displaces the one that waits
def count_people(_: Task, picture: int) -> int:
    return picture * 10


if __name__ == "__main__":
    with display.running():
        display.command(SHOW, "the weather", sequential=False)
        busy.wait(10)  # from here on, everything waits
        last = display.command(SHOW, "the news", sequential=False)
        display.command(SHOW, "a warning", sequential=False, priority=10)
        counts = [display.query_send(COUNT, picture) for picture in (1, 2, 3)]
        display.modules()  # the answer shows that central has received all messages above
        may_finish.set()
        last.wait(timeout=10)
        for pending in counts:
            try:
                print("people:", pending.receive(timeout=10))
            except QueryFailed as error:
                print(error)
