"""Check each move before it starts, without a change to the module that moves: a wiretap."""

from tca_module import Command, Condition, Failure, Module, Task, TaskFailed

MOVE, CHECK = Command("move", float), Command("check", float)
UNSTABLE = Failure("unstable", float)

legs, safety = Module("legs"), Module("safety")


@legs.handles(MOVE)
def move(_: Task, height: float) -> None:
    print("moved to", height)


@safety.at_start
def watch(module: Module) -> None:
    # Before each move: send CHECK with its data, and wait for the end of the check.
    module.tap(Condition.BEFORE_HANDLING, MOVE, CHECK)


@safety.handles(CHECK)
def check(_: Task, height: float) -> None:
    print("checks", height)
    if height > 0.5:
        raise UNSTABLE(height)


if __name__ == "__main__":
    with safety.running(), legs.running():
        for height in (0.2, 0.6):
            try:
                legs.command(MOVE, height).result(timeout=5)
            except TaskFailed as error:
                print(error)
