"""The leg recovery planner: finds the leg's way from its foothold to the next one."""

from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.messages import ELEVATION_MAP, NO_PATH, PLAN_LEG_RECOVERY, Placing
from robots.ambler_sim.planning.leg_recovery import plan_leg_move, window_of
from robots.ambler_sim.vocabulary import LegMove
from tca_module import Module, Task

planner = Module("leg recovery planner")


@planner.handles(PLAN_LEG_RECOVERY)
def leg_recovery(task: Task, placing: Placing) -> LegMove:
    """High enough over the ground on its way."""
    ground = task.query(ELEVATION_MAP, window_of(placing.step))
    try:
        return plan_leg_move(ground, placing.step, placing.foothold)
    except AmblerError as error:
        raise NO_PATH(placing, str(error)) from error


if __name__ == "__main__":
    planner.run()
