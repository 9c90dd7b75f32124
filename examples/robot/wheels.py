"""Drive to places. The driver has a bug: the third drive of each run aborts the program."""

import os
from itertools import count

from tca_module import Command, Module, Task

DRIVE = Command("drive", str)
wheels = Module("wheels")
drives = count(1)


@wheels.handles(DRIVE)
def drive(_: Task, place: str) -> None:
    if next(drives) == 3:
        os.abort()
    print("to the", place)


if __name__ == "__main__":
    wheels.run()
