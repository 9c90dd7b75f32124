"""Set a deadline for a task, and handle the failure "timeout" when it is missed."""

from tca_module import TIMEOUT, Command, ExceptionHandler, Module, Task, TaskFailed, connect

DOCK = Command("dock", str)  # the sensor to use
USE_SONAR = ExceptionHandler("use the sonar")

robot, expert = Module("robot"), Module("expert")


@robot.handles(DOCK)
def dock(task: Task, sensor: str) -> None:
    print("look for the dock with the", sensor)
    if sensor == "camera":
        task.sleep(60)  # finds nothing; a kill or retry ends the sleep


@expert.handles(USE_SONAR)
def use_sonar(task: Task) -> None:
    docking = task.trouble.failing
    print(task.trouble.text)
    docking.retry(DOCK, "sonar")
    docking.deadline(5)  # the first deadline has passed


if __name__ == "__main__":
    with robot.running(), expert.running(), connect("user") as user:
        try:
            user.command(DOCK, "camera", deadline=0.2).result()
        except TaskFailed as error:
            print(error)

        user.on_failure(TIMEOUT, USE_SONAR, of=DOCK)
        print("docking is", user.command(DOCK, "camera", deadline=0.2).wait(timeout=10))
