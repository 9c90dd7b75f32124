"""One goal for each cup that is seen, with a monitor that kills the goal when the cup is gone.

After Simmons (1990). Output::

    fetch the blue cup
    fetch the red cup
    the blue cup is gone: given up
    fetched the red cup
"""

import threading
import time

from tca_module import Command, DemonMonitor, Goal, Module, PollingMonitor, Query, Task

LOOK_FOR_CUPS = Command("look for cups")
FETCH, GRASP = Goal("fetch cup", str), Command("grasp", str)
IS_GONE, GIVE_UP = Query("is the cup gone", str, reply=bool), Command("give up", str)
NEW_CUPS = DemonMonitor("new cups", set_up=LOOK_FOR_CUPS, action=FETCH)
CUP_GONE = PollingMonitor("cup gone", str, condition=IS_GONE, action=GIVE_UP)

vision, robot = Module("vision"), Module("robot")
robot.resource("arm")
ended = threading.Semaphore(0)


@vision.handles(LOOK_FOR_CUPS)
def look(task: Task) -> None:
    for cup in ("blue", "red"):
        task.monitor_ref.fire(FETCH, cup)


@vision.handles(IS_GONE)
def is_gone(_: Task, cup: str) -> bool:
    return cup == "blue"  # another person picked it up


@robot.handles(FETCH)
def fetch(task: Task, cup: str) -> None:
    print(f"fetch the {cup} cup")
    task.monitor(CUP_GONE, cup, period=0.02)
    task.command(GRASP, cup)


@robot.handles(GRASP, resource="arm")
def grasp(task: Task, cup: str) -> None:
    while cup == "blue" and not task.cancelled:  # search until the goal is killed
        time.sleep(0.01)
    print(f"the {cup} cup is gone: given up" if task.cancelled else f"fetched the {cup} cup")
    ended.release()


@robot.handles(GIVE_UP)
def give_up(task: Task, _: str) -> None:
    task.monitor_ref.ancestors(FETCH)[0].kill("the cup is gone")


if __name__ == "__main__":
    with vision.running(), robot.running():
        robot.monitor(NEW_CUPS, maximum=2)
        ended.acquire()
        ended.acquire()
