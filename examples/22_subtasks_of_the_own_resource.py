"""Use one's own resource: a handler waits for subtasks of its slot, or leaves the slot to them.

TDL says ``spawn with wait`` and POSTPONE.
"""

from tca_module import Command, Goal, LaterReply, Module, Task, connect

WALK, STEP, STAND, PHOTO = Goal("walk", int), Command("step", int), Goal("stand"), Command("photo")

legs = Module("legs")  # one resource with one slot
standing: list[LaterReply[None]] = []


@legs.handles(WALK)
def walk(task: Task, steps: int) -> None:
    for number in range(1, steps + 1):
        task.command(STEP, number).wait()  # the slot handles the step within this wait
    print("walked")


@legs.handles(STEP)
def step(_: Task, number: int) -> None:
    print("step", number)


@legs.handles(STAND)
def stand(task: Task) -> LaterReply[None]:
    standing.append(task.reply_later(frees_slot=True))  # the slot handles any message from now on
    return standing[0]


@legs.handles(PHOTO)
def photo(_: Task) -> None:
    print("photo while standing")
    standing[0].reply()


if __name__ == "__main__":
    with legs.running(), connect("user") as user:
        user.goal(WALK, 2).wait()
        still = user.goal(STAND)
        user.command(PHOTO, sequential=False).wait()
        still.wait()
        print("done")
