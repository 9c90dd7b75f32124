"""Cancel and update: a turn that may end at any time, and a drive that decides about requests."""

from tca_module import Command, Module, Task, TaskKilled, connect

TURN, DRIVE = Command("turn"), Command("drive", str)

wheels = Module("wheels")


@wheels.handles(TURN)  # the simple way: a cancel or a kill ends the sleep
def turn(task: Task) -> None:
    print("turn")
    try:
        task.sleep(60)  # raises TaskKilled
    finally:
        print("motors off")


@wheels.handles(DRIVE, takes=["update", "cancel"])  # the handler decides
def drive(task: Task, place: str) -> None:
    print("drive to the", place)
    try:
        while True:  # in steps of 0.1 s
            request = task.wait_for_request(timeout=0.1)
            if request is None:
                continue  # nothing is requested: the next step
            if request.transition == "cancel":
                print("cancel requested:", request.why)
                raise task.aborted()
            request.accept()
            print("drive to the", request.goal)
    finally:
        print("motors off")


if __name__ == "__main__":
    with wheels.running(), connect("user") as user:
        turning = user.command(TURN)
        turning.wait_for_state("running", timeout=10)
        turning.cancel("a person is in the way")
        try:
            turning.result(timeout=10)
        except TaskKilled as error:
            print(error)

        driving = user.command(DRIVE, "kitchen")
        driving.wait_for_state("running", timeout=10)
        driving.update("garden", timeout=10)  # returns when the handler has accepted it
        driving.cancel("it rains")  # returns at once
        print("outcome:", driving.wait(timeout=10))
