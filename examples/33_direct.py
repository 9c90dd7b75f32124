"""Messages that go from module to module directly: a map that is asked a thousand times a second,
and an observer.
"""

import sys
import threading
import time

from tca_module import Condition, Inform, Module, Query, Task

HEIGHT = Query("height", float, reply=float)
HEARD = Inform("heard", float)

ground, planner, observer = Module("ground"), Module("planner"), Module("observer")


@ground.handles(HEIGHT, direct=True)
def height(_: Task, x: float) -> float:
    return 0.1 * x


has_heard = threading.Event()


@observer.handles(HEARD)
def heard(_: Task, x: float) -> None:
    print("asked for", x)
    has_heard.set()


def say_how() -> None:
    (handler,) = planner.handlers(HEIGHT)
    print("directly" if handler.direct else "through central")


if __name__ == "__main__":
    with ground.running(), planner.running(), observer.running():
        say_how()
        began = time.monotonic()
        print("highest:", max(planner.query(HEIGHT, float(x)) for x in range(1001)))
        print(f"in {time.monotonic() - began:.2f} s", file=sys.stderr)
        tap = planner.tap(Condition.WHEN_SENT, HEIGHT, HEARD)  # the observer is to hear of it
        say_how()
        planner.query(HEIGHT, 7.0)
        has_heard.wait(
            10
        )  # an inform comes when it comes: who leaves before it is there does not hear it
        tap.remove()
        say_how()
