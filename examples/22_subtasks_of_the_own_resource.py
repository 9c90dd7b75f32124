"""A handler waits for subtasks that its own slot handles, or leaves the slot to any message."""

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
    standing.append(task.reply_later(frees_slot=True))  # from now on, any message
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
