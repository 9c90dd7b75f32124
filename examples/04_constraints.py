"""Constraints between points: the kettle is on before the table is laid, and tea waits for both."""

from tca_module import Command, Goal, Module, Task, this

TEA = Goal("tea")
BOIL, LAY, POUR = Command("boil water"), Command("lay table"), Command("pour")

kitchen, hands = Module("kitchen"), Module("hands")


@kitchen.handles(TEA)
def tea(task: Task) -> None:
    with task.parallel():
        boil = task.command(BOIL)
        lay = task.command(LAY, constraints=[boil.handling.start <= this.handling.start])
    pour = task.command(POUR)
    task.constrain(
        boil.achieving.end <= pour.achieving.start, lay.achieving.end <= pour.achieving.start
    )


@hands.handles(BOIL)
@hands.handles(LAY)
@hands.handles(POUR)
def act(task: Task) -> None:
    print(task.message)


if __name__ == "__main__":
    with kitchen.running(), hands.running():
        kitchen.goal(TEA).wait()
