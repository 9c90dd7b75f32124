"""Retry a command with a pause, and call for help after the last attempt."""

from tca_module import Command, Failure, Module, Retry, Task, connect

SLIPPED = Failure("slipped", str)
CALL_HELP = Command("call for help", str)
# At most three attempts. After the last one, CALL_HELP gets the data of the grasp.
GRASP = Command("grasp", str, retry=Retry(3, pause=0.1, failures=[SLIPPED], otherwise=CALL_HELP))

robot = Module("robot")
tries = iter(["slips", "slips", "holds", "slips", "slips", "slips"])


@robot.handles(GRASP)
def grasp(_: Task, thing: str) -> None:
    outcome = next(tries)
    print("the", thing, outcome)
    if outcome == "slips":
        raise SLIPPED(thing)


@robot.handles(CALL_HELP)
def call_help(_: Task, thing: str) -> None:
    print("please give me the", thing)


if __name__ == "__main__":
    with robot.running(), connect("user") as user:
        print("outcome:", user.command(GRASP, "cup").wait(timeout=10))
        print("outcome:", user.command(GRASP, "soap").wait(timeout=10))
