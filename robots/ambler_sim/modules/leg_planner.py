"""The leg planner: chooses a foothold near the ideal one and the leg's way there."""

from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.messages import ELEVATION_MAP, PLAN_LEG_MOVE, PLANNER_FAILED
from robots.ambler_sim.planning.footfall import choose_foothold
from robots.ambler_sim.planning.leg_recovery import plan_leg_move
from robots.ambler_sim.vocabulary import LegMove, Step
from tca_module import Module, Task

planner = Module("leg planner")


@planner.handles(PLAN_LEG_MOVE)
def leg_move(task: Task, step: Step) -> LegMove:
    """Where the step's leg is put down, and how it gets there."""
    ground = task.query(ELEVATION_MAP, step.before)
    try:
        return plan_leg_move(ground, step, choose_foothold(ground, step))
    except AmblerError as error:
        raise PLANNER_FAILED(f"leg {step.leg}", str(error)) from error


if __name__ == "__main__":
    planner.run()
