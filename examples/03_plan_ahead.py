"""Planning ahead: the planner plans one row ahead of the row that is being mown."""

import time

from tca_module import Command, Goal, Module, Task

MOW_LAWN, MOW_ROW, DRIVE = Goal("mow lawn", int), Goal("mow row", int), Command("drive", int)

planner, wheels = Module("planner"), Module("wheels")
diary: list[str] = []


@planner.handles(MOW_LAWN)
def mow_lawn(task: Task, rows: int) -> None:
    with task.sequence(plan_ahead=1):  # at most one row beyond the one being mown
        for row in range(rows):
            task.goal(MOW_ROW, row)


@planner.handles(MOW_ROW)
def mow_row(task: Task, row: int) -> None:
    diary.append(f"plan row {row}")
    task.command(DRIVE, row)


@wheels.handles(DRIVE)
def drive(_: Task, row: int) -> None:
    time.sleep(0.2)  # mowing takes a while
    diary.append(f"mow row {row}")


if __name__ == "__main__":
    with planner.running(), wheels.running():
        planner.goal(MOW_LAWN, 4).wait()
    print("\n".join(diary))
