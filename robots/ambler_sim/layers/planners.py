"""The planners' layer: the walk continues when a planner finds no foothold, no way or no pose."""

from robots.ambler_sim.messages import (
    MOTION_FAULT,
    NO_FOOTFALL,
    NO_PATH,
    NO_POSE,
    NOT_THERE,
    TAKE_STEPS,
    TRAVERSE_ARC,
)
from robots.ambler_sim.recovery import PLAN_OTHERWISE, SHUFFLE_FEET, make_layer
from tca_module import Module

layer = make_layer("planners")


@layer.at_start
def attach(module: Module) -> None:
    """Take the step with another leg or make it shorter; else begin the arc again."""
    for failure in (NO_FOOTFALL, NO_PATH, NO_POSE, NOT_THERE, MOTION_FAULT):
        module.on_failure(failure, PLAN_OTHERWISE, of=TAKE_STEPS)
        module.on_failure(failure, SHUFFLE_FEET, of=TRAVERSE_ARC, maximum=6)


if __name__ == "__main__":
    layer.run()
