"""Keep tasks after their end: an exception handler undoes them in reverse after a failure."""

from tca_module import Command, ExceptionHandler, Failure, Goal, Module, Recovery, Task

PACK, STOW = Goal("pack"), Command("stow", str)
FULL, UNPACK = Failure("box is full", str), ExceptionHandler("unpack")

planner, arm, expert = Module("planner"), Module("arm"), Module("expert")


@planner.handles(PACK)
def pack(task: Task) -> None:
    for thing in ("cup", "plate", "kettle", "table"):
        task.command(STOW, thing, keep=True)  # its record is retained until the packing ends


@arm.handles(STOW)
def stow(_: Task, thing: str) -> None:
    if thing == "kettle":
        raise FULL(thing)
    print("stowed the", thing)


@expert.handles(UNPACK)
def unpack(task: Task) -> None:
    packing = task.trouble.attached  # the task that was sent with on_failure=
    assert packing is not None
    for stowed in reversed(packing.kept(STOW)):
        print("took out the", stowed.data(STOW))
    packing.kill("does not fit")


if __name__ == "__main__":
    with planner.running(), arm.running(), expert.running():
        packing = planner.goal(PACK, on_failure=[Recovery(FULL, UNPACK)])
        print("packing was", packing.wait(timeout=10))
