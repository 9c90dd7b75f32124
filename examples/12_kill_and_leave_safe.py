"""A task is killed from outside. Its running handler is told, not interrupted; what leaves the
robot safe is done.
"""

import threading
import time

from tca_module import Command, Goal, Module, Task

DIG, DRILL, RETRACT, DRIVE_ON = (
    Goal("dig"),
    Command("drill"),
    Command("retract the drill"),
    Command("drive on"),
)

planner, drill, wheels = Module("planner"), Module("drill"), Module("wheels")
drilling = threading.Event()


@planner.handles(DIG)
def dig(task: Task) -> None:
    task.on_termination(RETRACT)
    task.command(DRILL)


@drill.handles(DRILL)
def run_drill(task: Task) -> None:
    print("drilling")
    drilling.set()
    while not task.cancelled:
        time.sleep(0.01)
    print("told to stop, stopped")


@drill.handles(
    RETRACT
)  # sent at once: it comes after the drilling because the drill handles one message at a time
def retract(_: Task) -> None:
    print("retracted")


@wheels.handles(DRIVE_ON)
def drive_on(_: Task) -> None:
    print("driving on")


if __name__ == "__main__":
    with planner.running(), drill.running(), wheels.running():
        digging = planner.goal(DIG)
        going = planner.command(DRIVE_ON)  # when the digging is over, however it ends
        drilling.wait(10)
        digging.kill("hit bedrock")
        going.wait(timeout=10)
        print("digging was", digging.wait())
