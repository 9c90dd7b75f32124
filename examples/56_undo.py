"""Undo what was done when a later step fails: the fallback of a goal."""

from tca_module import Command, Failure, Goal, Module, Outcome, Retry, Task

DELIVER, UNDO = Goal("deliver"), Command("undo")
RESERVE, RELEASE = Command("reserve", str), Command("release", str)
BUSY = Failure("busy", str)

planner, store = Module("planner"), Module("store")


@planner.handles(DELIVER)
def deliver(task: Task) -> None:
    for thing in ("cart", "lift", "door", "lamp"):
        task.command(RESERVE, thing, keep=True)  # its record is retained until the goal ends


@planner.handles(UNDO)
def undo(task: Task) -> None:  # the fallback stands under the goal
    goal = task.parent()
    assert goal is not None
    for done in reversed(goal.kept(RESERVE)):
        if done.wait() is Outcome.DONE:  # not the one that failed, nor later ones
            task.command(RELEASE, done.data(RESERVE))


@store.handles(RESERVE)
def reserve(_: Task, thing: str) -> None:
    if thing == "door":
        raise BUSY(thing)
    print("reserved the", thing)


@store.handles(RELEASE)
def release(_: Task, thing: str) -> None:
    print("released the", thing)


if __name__ == "__main__":
    with planner.running(), store.running():
        delivery = planner.goal(DELIVER, retry=Retry(1, otherwise=UNDO))
        print("the delivery is", delivery.wait(timeout=10))
