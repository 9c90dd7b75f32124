"""Add a monitor to a task of another module while it runs. The monitor ends with the task.

Output::

    walking
    the battery is low
    stopped
    the walk was killed, and its monitor killed
"""

import itertools
import threading
import time

from tca_module import Command, Module, PollingMonitor, Query, Task, connect
from tca_module.testing import LocalCentral

WALK, STOP = Command("walk"), Command("stop")
IS_LOW = Query("is the battery low", reply=bool)
BATTERY = PollingMonitor("battery", condition=IS_LOW, action=STOP)

legs, watcher = Module("legs"), Module("watcher")
walking, tests = threading.Event(), itertools.count()


@legs.handles(WALK)
def walk(task: Task) -> None:
    print("walking")
    walking.set()
    while not task.cancelled:
        time.sleep(0.01)
    print("stopped")


@watcher.handles(IS_LOW)
def is_low(_: Task) -> bool:
    return next(tests) == 3


@watcher.handles(STOP)
def stop(task: Task) -> None:
    print("the battery is low")
    task.monitor_ref.ancestors(WALK)[0].kill("the battery is low")


if __name__ == "__main__":
    with LocalCentral() as central:
        legs.central = watcher.central = central
        with legs.running(), watcher.running(), connect("user", central) as user:
            sent = user.command(WALK)
            walking.wait(5)
            monitor = watcher.under(watcher.tasks(WALK)[0]).monitor(BATTERY, period=0.02)
            print(f"the walk was {sent.wait(5)}, and its monitor {monitor.wait(5)}")
