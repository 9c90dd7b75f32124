"""The footfall planner: chooses the foothold near the ideal one."""

from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.messages import ELEVATION_MAP, NO_FOOTFALL, PLAN_FOOTFALL
from robots.ambler_sim.planning.footfall import choose_foothold, window_of
from robots.ambler_sim.vocabulary import Foot, Step
from tca_module import Module, Task

planner = Module("footfall planner")


@planner.handles(PLAN_FOOTFALL)
def footfall(task: Task, step: Step) -> Foot:
    """Where the step's leg is put down."""
    ground = task.query(ELEVATION_MAP, window_of(step))
    try:
        return choose_foothold(ground, step)
    except AmblerError as error:
        raise NO_FOOTFALL(step, str(error)) from error


if __name__ == "__main__":
    planner.run()
