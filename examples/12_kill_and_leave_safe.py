"""Kill a running task and leave the robot safe.

The kill cancels the running handler cooperatively. Then a termination message retracts the drill.
"""

import threading
import time

from tca_module import Command, Goal, Module, Task

DIG, DRILL = Goal("dig"), Command("drill")
RETRACT, DRIVE_ON = Command("retract the drill"), Command("drive on")

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
    print("drilling was cancelled")


# RETRACT is sent at once. It waits for the end of the drilling, because the drill handles one
# message at a time.
@drill.handles(RETRACT)
def retract(_: Task) -> None:
    print("retracted")


@wheels.handles(DRIVE_ON)
def drive_on(_: Task) -> None:
    print("driving on")


if __name__ == "__main__":
    with planner.running(), drill.running(), wheels.running():
        digging = planner.goal(DIG)
        going = planner.command(DRIVE_ON)  # starts when the digging ends, whatever its outcome
        drilling.wait(10)
        digging.kill("hit bedrock")
        going.wait(timeout=10)
        print("digging was", digging.wait())
