"""Recover: if the hall is blocked, drive through the garden."""

from tca_module import ExceptionHandler, Module, Task

from messages import BLOCKED, DRIVE, Way

GO_ROUND = ExceptionHandler("go round", Way)
recovery = Module("recovery")


@recovery.at_start
def attach(module: Module) -> None:
    module.on_failure(BLOCKED, GO_ROUND, of=DRIVE, maximum=1)


@recovery.handles(GO_ROUND)
def go_round(task: Task, blocked: Way) -> None:
    task.trouble.failing.retry(DRIVE, Way(blocked.room, "garden"))


if __name__ == "__main__":
    recovery.run()
