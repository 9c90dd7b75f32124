"""Recover: if the hall is blocked, drive through the garden."""

from tca_module import ExceptionHandler, Module, Task

from messages import BLOCKED, DRIVE, Way

TAKE_DETOUR = ExceptionHandler("take detour", Way)
recovery = Module("recovery")


@recovery.at_start
def attach(module: Module) -> None:
    module.on_failure(BLOCKED, TAKE_DETOUR, of=DRIVE, maximum=1)


@recovery.handles(TAKE_DETOUR)
def take_detour(task: Task, blocked: Way) -> None:
    task.trouble.failing.retry(DRIVE, Way(blocked.room, "garden"))


if __name__ == "__main__":
    recovery.run()
