"""Patrol on a round. Retry a drive, at most twice, after its program died and came back."""

from tca_module import Command, ExceptionHandler, Goal, Module, Task

PATROL, DRIVE = Goal("patrol"), Command("drive", str)
AGAIN = ExceptionHandler("drive again")
patrol = Module("patrol")
# None: after any failure of a drive.
patrol.at_start(lambda module: module.on_failure(None, AGAIN, of=DRIVE, maximum=2))


@patrol.handles(PATROL)
def make_round(task: Task) -> None:
    with task.sequence():
        for place in ("kitchen", "hall", "door", "charger"):
            task.command(DRIVE, place)


@patrol.handles(AGAIN)
def again(task: Task) -> None:
    task.trouble.failing.retry()


if __name__ == "__main__":
    with patrol.running():
        print("the round is", patrol.goal(PATROL).wait())
