"""A wiretap and a monitor extend a robot without changes to its modules.

The wiretap adds a check before each move. The monitor fetches each cup that is seen.

Output::

    checked 0.2
    moved 0.2
    checked 0.4
    moved 0.4
    fetch the blue cup
    fetch the red cup
"""

import threading

from tca_module import Command, Condition, DemonMonitor, Goal, Module, Task, connect
from tca_module.testing import LocalCentral

MOVE, CHECK = Command("move", float), Command("check", float)
WATCH, FETCH = Command("watch for cups"), Goal("fetch cup", str)
CUPS = DemonMonitor("cups", set_up=WATCH, action=FETCH)

legs, safety, vision = Module("legs"), Module("safety"), Module("vision")
fetched = threading.Semaphore(0)


@legs.handles(MOVE)
def move(_: Task, to: float) -> None:
    print("moved", to)


@safety.handles(CHECK)
def check(task: Task, to: float) -> None:
    assert task.tap_event.condition is Condition.BEFORE_HANDLING
    print("checked", to)


@vision.handles(WATCH)
def watch(task: Task) -> None:
    for cup in ("blue", "red"):
        task.monitor_ref.fire(FETCH, cup)


@legs.handles(FETCH)
def fetch(_: Task, cup: str) -> None:
    print(f"fetch the {cup} cup")
    fetched.release()


if __name__ == "__main__":
    with LocalCentral() as central:
        legs.central = safety.central = vision.central = central
        with legs.running(), safety.running(), vision.running(), connect("user", central) as user:
            user.tap(Condition.BEFORE_HANDLING, MOVE, CHECK)
            for place in (0.2, 0.4):
                user.command(MOVE, place).wait(timeout=5)
            user.monitor(CUPS, maximum=2)
            fetched.acquire()
            fetched.acquire()
