"""Update, cancel and kill a drive. The handler stops the motors in each case."""

from tca_module import Command, Module, Task, TaskKilled, connect

DRIVE = Command("drive", str)

wheels = Module("wheels")


@wheels.handles(DRIVE, takes=["update", "cancel"])
def drive(task: Task, place: str) -> None:
    print("drive to the", place)
    try:
        for request in task.requests():  # waits; raises TaskKilled after a kill
            if request.transition == "cancel":
                print("cancel requested:", request.why)
                raise task.aborted()
            request.accept()
            print("drive to the", request.goal)
    finally:
        print("motors off")


if __name__ == "__main__":
    with wheels.running(), connect("user") as user:
        drive_1 = user.command(DRIVE, "kitchen")
        drive_1.wait_for_state("running", timeout=10)
        drive_1.update("garden", timeout=10)  # returns when the handler has accepted it
        drive_1.cancel("it rains")  # returns at once
        print("outcome:", drive_1.wait(timeout=10))

        drive_2 = user.command(DRIVE, "kitchen")
        drive_2.wait_for_state("running", timeout=10)
        drive_2.kill("a person is in the way")
        try:
            drive_2.result(timeout=10)
        except TaskKilled as error:
            print(error)
