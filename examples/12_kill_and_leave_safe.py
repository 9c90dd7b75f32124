"""Kill a running task and leave the robot safe.

The kill ends the handler's sleep. Then central sends the termination message.
"""

from tca_module import Command, Module, Task, connect

DRILL, RETRACT = Command("drill"), Command("retract the drill")
DRIVE_ON = Command("drive on")

drill, wheels = Module("drill"), Module("wheels")


@drill.handles(DRILL)
def run_drill(task: Task) -> None:
    task.on_termination(RETRACT)  # sent if this task is killed
    print("drilling")
    try:
        task.sleep(60)  # raises TaskKilled after a kill
    finally:
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
    with drill.running(), wheels.running(), connect("operator") as operator:
        drilling = operator.command(DRILL)
        driving = operator.command(DRIVE_ON)  # starts after the drilling, whatever its outcome
        drilling.wait_for_state("running", timeout=10)
        drilling.kill("hit bedrock")
        driving.wait(timeout=10)
        print("drilling was", drilling.wait())
