"""Retry a task that fails, then do something else, without an exception handler."""

from tca_module import (
    TIMEOUT,
    Command,
    ExceptionHandler,
    Failure,
    Goal,
    Module,
    Retry,
    Task,
    connect,
)

SLIPPED = Failure("slipped", str)
GRASP = Command("grasp", str, retry=Retry(3, pause=0.1, failures=[SLIPPED]))
CALL_HELP = Command("call help", str)
WAIT_FOR_LIFT = Command("wait for lift")
CLIMB = Goal("climb")
TAKE_STAIRS = ExceptionHandler("take stairs")

robot = Module("robot")


@robot.handles(GRASP)
def grasp(_: Task, thing: str) -> None:
    print("grasping", thing)
    if thing == "soap":
        raise SLIPPED(thing)


@robot.handles(CALL_HELP)
def call_help(_: Task, thing: str) -> None:
    print("please give me the", thing)


@robot.handles(CLIMB)
def climb(task: Task) -> None:
    task.command(WAIT_FOR_LIFT)


@robot.handles(WAIT_FOR_LIFT)
def wait_for_lift(task: Task) -> None:
    print("waiting for the lift")
    task.sleep(60)


@robot.handles(TAKE_STAIRS)
def take_stairs(task: Task) -> None:
    assert task.trouble is not None
    print("taking the stairs after", task.trouble.failure, "of attempt", task.trouble.attempts)
    task.trouble.failing.kill()


if __name__ == "__main__":
    robot.resource("robot", capacity=2)
    with robot.running(), connect("user") as user:
        # The sender's policy replaces the declared one.
        patient = Retry(2, pause=0.1, otherwise=CALL_HELP)
        print(user.command(GRASP, "soap", retry=patient).wait(timeout=10))
        print(user.command(GRASP, "cup").wait(timeout=10))
        # A failure of central has a name, too.
        user.on_failure(TIMEOUT, TAKE_STAIRS, of=CLIMB)
        impatient = Retry(2, pause=0.1, attempt_timeout=0.3)
        print(user.goal(CLIMB, retry=impatient).wait(timeout=10))
