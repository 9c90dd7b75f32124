"""The layer against tipping over.

A tilting body stops a move. The move is retried when the body is level, or is planned in another
way. No move begins while a leg that should stand bears no load.
"""

import math

from robots.ambler_sim.messages import (
    LEVEL_BODY,
    MOVE_BODY,
    MOVE_LEG,
    READINGS,
    STANCE,
    TAKE_STEPS,
    TIP_OVER_RISK,
    TRAVERSE_ARC,
)
from robots.ambler_sim.planning.checks import LEAST_LOAD, LEAST_SUPPORT
from robots.ambler_sim.planning.stability import support_margin
from robots.ambler_sim.recovery import PLAN_OTHERWISE, SHUFFLE_FEET, make_layer
from robots.ambler_sim.vocabulary import Readings
from tca_module import Command, Condition, ExceptionHandler, Module, Task

MOST_TILT = 0.015
"""The inclination (rad) above which the standing robot is levelled: 0.9 degrees."""

STEADY = ExceptionHandler("steady", float)
SUPPORT_CHECK = Command("support check")

layer = make_layer("tip over")


@layer.at_start
def attach(module: Module) -> None:
    """Tap the moves. A move that tilts the robot is retried twice at most."""
    for move in (MOVE_LEG, MOVE_BODY):
        module.tap(Condition.BEFORE_HANDLING, move, SUPPORT_CHECK)
        module.on_failure(TIP_OVER_RISK, STEADY, of=move, maximum=2)
    module.on_failure(TIP_OVER_RISK, PLAN_OTHERWISE, of=TAKE_STEPS)
    module.on_failure(TIP_OVER_RISK, SHUFFLE_FEET, of=TRAVERSE_ARC, maximum=6)


@layer.handles(STEADY)
def steady(task: Task, _: float) -> None:
    """Bring the robot to rest, level, and retry the move."""
    task.command(LEVEL_BODY).wait()
    task.trouble.failing.retry()


@layer.handles(SUPPORT_CHECK)
def support_check(task: Task) -> None:
    """Hold a move until the robot is level on six feet or, at least, stable on the loaded feet."""
    readings = task.query(READINGS)
    if not hanging_legs(readings) and tilt(readings) <= MOST_TILT:
        return
    task.command(LEVEL_BODY).wait()
    readings, stance = task.query(READINGS), task.query(STANCE)
    move = task.tap_event.tapped
    assert move is not None
    lifted = {move.data(MOVE_LEG).leg} if move.message == MOVE_LEG.name else set()
    margin = support_margin(stance, *lifted.union(hanging_legs(readings)))
    if margin < LEAST_SUPPORT:
        legs = ", ".join(map(str, hanging_legs(readings)))
        raise TIP_OVER_RISK(
            tilt(readings), f"{move} would leave {margin:.2f} m to the edge; hanging legs: {legs}"
        )


def hanging_legs(readings: Readings) -> list[int]:
    """Return the legs that bear no load."""
    return [leg for leg, load in enumerate(readings.loads) if load < LEAST_LOAD]


def tilt(readings: Readings) -> float:
    """Return the inclination (rad) of the body."""
    return math.hypot(readings.roll, readings.pitch)


if __name__ == "__main__":
    layer.run()
