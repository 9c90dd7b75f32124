"""Monitoring: before each leg and body move a stability check, after each leg move a footfall check (paper, figure 3).

Nobody sends these checks: wiretaps do. The modules that plan and move need not know of them.
"""

from robots.ambler_sim.messages import MOVE_BODY, MOVE_LEG, READINGS, STANCE
from robots.ambler_sim.planning.checks import fault_of_footfall, is_stable, margins_of_body_move, margins_of_leg_move
from robots.ambler_sim.reactions import FOOTFALL_CHECK, STABILITY_CHECK, UNSTABLE_FOOTHOLD, UNSTABLE_MOVE, Margins
from robots.ambler_sim.vocabulary import Contact, LegMove
from tca_module import Condition, Module, Task

monitoring = Module("monitoring")


@monitoring.at_start
def watch(module: Module) -> None:
    """Tap the moves. Handling, not achieving: a move that is retried is checked again."""
    module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, STABILITY_CHECK)
    module.tap(Condition.BEFORE_HANDLING, MOVE_BODY, STABILITY_CHECK)
    module.tap(Condition.WHEN_ACHIEVED, MOVE_LEG, FOOTFALL_CHECK)


@monitoring.handles(STABILITY_CHECK)
def stability_check(task: Task) -> Margins:
    """Hold the tapped move until it is known that the robot will not tip over; if it would, that is a failure of it."""
    move, stance = task.tap_event.tapped, task.query(STANCE)
    assert move is not None
    if move.message == MOVE_LEG.name:
        margins = margins_of_leg_move(stance, move.data(MOVE_LEG))
    else:
        margins = margins_of_body_move(stance, move.data(MOVE_BODY))
    if not is_stable(margins):
        raise UNSTABLE_MOVE(margins, f"{move} would leave only {margins}")
    return margins


@monitoring.handles(FOOTFALL_CHECK)
def footfall_check(task: Task, move: LegMove) -> None:
    """The leg move is not achieved until its foot is known to stand well."""
    stance, readings = task.query(STANCE), task.query(READINGS)
    if fault := fault_of_footfall(move, stance, readings):
        foot = stance.feet[move.leg]
        raise UNSTABLE_FOOTHOLD(Contact(move.leg, foot.x, foot.y, foot.z, readings.loads[move.leg]), fault)


if __name__ == "__main__":
    monitoring.run()
