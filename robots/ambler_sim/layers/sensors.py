"""The layer for sensors that fail: images that are missing or can't be true, and force sensors that
say nothing.
"""

import math

from robots.ambler_sim.messages import (
    ACQUIRE_IMAGE,
    BAD_IMAGE,
    CALIBRATE,
    MOVE_LEG,
    NO_IMAGE,
    READINGS,
)
from robots.ambler_sim.recovery import make_layer
from tca_module import Command, Condition, ExceptionHandler, Module, Task

LOOKED_AT_MOST = 3

LOOK_AGAIN = ExceptionHandler("look again", int)
GO_ON_WITHOUT = ExceptionHandler("go on without image", int)
FORCE_CHECK = Command("force check")

layer = make_layer("sensors")


@layer.at_start
def attach(module: Module) -> None:
    """An image is taken again some times; after that the walk goes on with the map as it is."""
    module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, FORCE_CHECK)
    for failure in (NO_IMAGE, BAD_IMAGE):
        module.on_failure(failure, GO_ON_WITHOUT, of=ACQUIRE_IMAGE)
        module.on_failure(failure, LOOK_AGAIN, of=ACQUIRE_IMAGE, maximum=LOOKED_AT_MOST)


@layer.handles(LOOK_AGAIN)
def look_again(task: Task, _: int) -> None:
    """Take the image once more."""
    task.trouble.failing.retry()


@layer.handles(GO_ON_WITHOUT)
def go_on_without(task: Task, _: int) -> None:
    """The map reaches some metres further than the next step."""
    task.trouble.resolved()


@layer.handles(FORCE_CHECK)
def force_check(task: Task) -> None:
    """Hold a leg move until all force sensors say something."""
    for leg, load in enumerate(task.query(READINGS).loads):
        if not math.isfinite(load):
            task.command(CALIBRATE, leg).wait()


if __name__ == "__main__":
    layer.run()
