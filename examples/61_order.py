"""Four ways to order tasks: a block, a constraint, a resource, and a wait in the handler."""

from tca_module import Command, Goal, Module, Task, connect, this

BREAKFAST = Goal("breakfast")
BOIL, LAY, TOAST = Command("boil water"), Command("lay table"), Command("toast bread")
POUR, TASTE, SWEETEN = Command("pour tea"), Command("taste", result=str), Command("add sugar")

cook = Module("cook")
hands = Module("hands")  # a resource with one slot: one command at a time


@cook.handles(BREAKFAST)
def breakfast(task: Task) -> None:
    with task.parallel():  # a block: in any order, and before the pouring
        boil = task.command(BOIL)
        task.command(LAY)
        # A constraint, also between tasks of different blocks or programs.
        task.command(TOAST, constraints=[boil.achieving.end <= this.achieving.start])
    task.command(POUR)
    if task.command(TASTE).result() == "bitter":  # a wait: the next step depends on the result
        task.command(SWEETEN)


@hands.handles(BOIL)
@hands.handles(LAY)
@hands.handles(TOAST)
@hands.handles(POUR)
@hands.handles(SWEETEN)
def act(task: Task) -> None:
    print(task.message)


@hands.handles(TASTE)
def taste(_: Task) -> str:
    print("it tastes bitter")
    return "bitter"


if __name__ == "__main__":
    with cook.running(), hands.running(), connect("guest") as guest:
        guest.goal(BREAKFAST).result(timeout=10)
