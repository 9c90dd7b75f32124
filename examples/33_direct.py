"""Direct messages skip central. While a wiretap watches them, they go through central again.

They always go through central if the folder of its socket has a path of more than 75 characters.
"""

import sys
import threading
import time

from tca_module import Condition, Inform, Module, Query, Task

HEIGHT = Query("height", float, reply=float)
ASKED = Inform("asked", float)

ground, planner, observer = Module("ground"), Module("planner"), Module("observer")


@ground.handles(HEIGHT, direct=True)
def height(_: Task, x: float) -> float:
    return 0.1 * x


was_asked = threading.Event()


@observer.handles(ASKED)
def asked(_: Task, x: float) -> None:
    print("asked for", x)
    was_asked.set()


def print_route() -> None:
    (handler,) = planner.handlers(HEIGHT)
    print("directly" if handler.direct else "through central")


if __name__ == "__main__":
    with ground.running(), planner.running(), observer.running():
        print_route()
        started = time.monotonic()
        print("highest:", max(planner.query(HEIGHT, float(x)) for x in range(1001)))
        print(f"in {time.monotonic() - started:.2f} s", file=sys.stderr)
        tap = planner.tap(Condition.WHEN_SENT, HEIGHT, ASKED)
        print_route()
        planner.query(HEIGHT, 7.0)
        was_asked.wait(10)  # the inform of the wiretap arrives some time later
        tap.remove()
        print_route()
