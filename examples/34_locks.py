"""A scanner locks the controller of the body, so that moves wait until the scan is done.

Output::

    scan
    scanned
    move 1
"""

import threading

from tca_module import Command, Module, Query, Task, connect
from tca_module.testing import LocalCentral

SCAN = Query("scan", reply=str)
MOVE = Command("move", int)

scanner, controller = Module("scanner"), Module("controller")
scanning, seen = threading.Event(), threading.Event()


@scanner.handles(SCAN)
def scan(task: Task) -> str:
    # Waits for a running move. No other move starts before the end of the block.
    with task.lock("controller", timeout=5.0):
        print("scan")
        scanning.set()
        seen.wait(5)
        print("scanned")
    return "a map"


@controller.handles(MOVE)
def move(_: Task, number: int) -> None:
    print(f"move {number}")


if __name__ == "__main__":
    with LocalCentral() as central:
        scanner.central = controller.central = central
        with scanner.running(), controller.running(), connect("user", central) as user:
            asked = user.query_send(SCAN)
            scanning.wait(5)
            moving = user.command(MOVE, 1)  # waits in the controller's queue
            seen.set()
            moving.result(5)
            asked.receive()
