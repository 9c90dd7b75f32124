"""The footfall layer: a leg move is achieved only after a check of its foot (paper, figure 3)."""

from robots.ambler_sim.messages import MOVE_LEG, READINGS, STANCE, TAKE_STEPS
from robots.ambler_sim.planning.checks import fault_of_footfall
from robots.ambler_sim.recovery import REPLAN_MOVE, make_layer
from robots.ambler_sim.vocabulary import Contact, LegMove
from tca_module import Command, Condition, Failure, Module, Task

FOOTFALL_CHECK = Command("footfall check", LegMove)
UNSTABLE_FOOTHOLD = Failure("unstable foothold", Contact)

layer = make_layer("footfall")


@layer.at_start
def attach(module: Module) -> None:
    """Tap the leg moves. A bad foothold is replaced by another one."""
    module.tap(Condition.WHEN_ACHIEVED, MOVE_LEG, FOOTFALL_CHECK)
    module.on_failure(UNSTABLE_FOOTHOLD, REPLAN_MOVE, of=TAKE_STEPS)


@layer.handles(FOOTFALL_CHECK)
def footfall_check(task: Task, move: LegMove) -> None:
    """Check that the foot bears load near its foothold."""
    stance, readings = task.query(STANCE), task.query(READINGS)
    if fault := fault_of_footfall(move, stance, readings):
        foot = stance.feet[move.leg]
        raise UNSTABLE_FOOTHOLD(
            Contact(move.leg, foot.x, foot.y, foot.z, readings.loads[move.leg]), fault
        )


if __name__ == "__main__":
    layer.run()
