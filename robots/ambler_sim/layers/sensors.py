"""The sensor layer: missing or impossible images, and force sensors without a value."""

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

MOST_RETRIES = 3
"""The greatest number of retries of one image."""

LOOK_AGAIN = ExceptionHandler("look again", int)
GO_ON_WITHOUT_IMAGE = ExceptionHandler("go on without image", int)
FORCE_CHECK = Command("force check")

layer = make_layer("sensors")


@layer.at_start
def attach(module: Module) -> None:
    """Take a failed image again a few times, then continue the walk with the present map."""
    module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, FORCE_CHECK)
    for failure in (NO_IMAGE, BAD_IMAGE):
        module.on_failure(failure, GO_ON_WITHOUT_IMAGE, of=ACQUIRE_IMAGE)
        module.on_failure(failure, LOOK_AGAIN, of=ACQUIRE_IMAGE, maximum=MOST_RETRIES)


@layer.handles(LOOK_AGAIN)
def look_again(task: Task, _: int) -> None:
    """Take the image once more."""
    task.trouble.failing.retry()


@layer.handles(GO_ON_WITHOUT_IMAGE)
def go_on_without_image(task: Task, _: int) -> None:
    """Resolve the failure: the map reaches some metres beyond the next step."""
    task.trouble.resolved()


@layer.handles(FORCE_CHECK)
def force_check(task: Task) -> None:
    """Hold a leg move until all force sensors have values."""
    for leg, load in enumerate(task.query(READINGS).loads):
        if not math.isfinite(load):
            task.command(CALIBRATE, leg).wait()


if __name__ == "__main__":
    layer.run()
