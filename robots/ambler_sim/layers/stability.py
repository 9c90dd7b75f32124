"""The stability layer: a check against tipping over before each leg and body move (paper, figure
3).
"""

from robots.ambler_sim.messages import MOVE_BODY, MOVE_LEG, STANCE, TAKE_STEPS, TRAVERSE_ARC
from robots.ambler_sim.planning.checks import (
    Margins,
    is_stable,
    margins_of_body_move,
    margins_of_leg_move,
)
from robots.ambler_sim.recovery import PLAN_OTHERWISE, SHUFFLE_FEET, make_layer
from tca_module import Command, Condition, Failure, Module, Task

STABILITY_CHECK = Command("stability check", result=Margins)
UNSTABLE_MOVE = Failure("unstable move", Margins)

layer = make_layer("stability")


@layer.at_start
def attach(module: Module) -> None:
    """Tap the handling of the moves, not their achievement, so that a retried move is checked
    again.
    """
    module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, STABILITY_CHECK)
    module.tap(Condition.BEFORE_HANDLING, MOVE_BODY, STABILITY_CHECK)
    module.on_failure(UNSTABLE_MOVE, PLAN_OTHERWISE, of=TAKE_STEPS, maximum=1)
    module.on_failure(UNSTABLE_MOVE, SHUFFLE_FEET, of=TRAVERSE_ARC, maximum=6)


@layer.handles(STABILITY_CHECK)
def stability_check(task: Task) -> Margins:
    """Hold the tapped move until its margins are known. Raises UNSTABLE_MOVE if they are small."""
    move, stance = task.tap_event.tapped, task.query(STANCE)
    assert move is not None
    if move.message == MOVE_LEG.name:
        margins = margins_of_leg_move(stance, move.data(MOVE_LEG))
    else:
        margins = margins_of_body_move(stance, move.data(MOVE_BODY))
    if not is_stable(margins):
        raise UNSTABLE_MOVE(margins, f"{move} would leave only {margins}")
    return margins


if __name__ == "__main__":
    layer.run()
