"""The planners that answer queries, a program each: footfall, leg recovery and body planner."""

from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.messages import (
    ELEVATION_MAP,
    NO_FOOTFALL,
    NO_PATH,
    NO_POSE,
    PLAN_BODY_MOVE,
    PLAN_FOOTFALL,
    PLAN_LEG_RECOVERY,
    Placing,
)
from robots.ambler_sim.planning import leg_recovery
from robots.ambler_sim.planning.footfall import choose_foothold, window_of
from robots.ambler_sim.planning.gait import plan_body_move
from robots.ambler_sim.vocabulary import BodyMove, Foot, LegMove, Step
from robots.options import program_parser
from tca_module import Module, Task

footfall_planner = Module("footfall planner")
leg_recovery_planner = Module("leg recovery planner")
body_planner = Module("body planner")

PLANNERS = {
    planner.name: planner for planner in (footfall_planner, leg_recovery_planner, body_planner)
}


@footfall_planner.handles(PLAN_FOOTFALL)
def plan_footfall(task: Task, step: Step) -> Foot:
    """Choose the foothold of the step's leg, near the ideal one."""
    ground = task.query(ELEVATION_MAP, window_of(step))
    try:
        return choose_foothold(ground, step)
    except AmblerError as error:
        raise NO_FOOTFALL(step, str(error)) from error


@leg_recovery_planner.handles(PLAN_LEG_RECOVERY)
def plan_leg_recovery(task: Task, placing: Placing) -> LegMove:
    """Plan the leg's way to its next foothold, high enough over the ground."""
    ground = task.query(ELEVATION_MAP, leg_recovery.window_of(placing.step))
    try:
        return leg_recovery.plan_leg_move(ground, placing.step, placing.foothold)
    except AmblerError as error:
        raise NO_PATH(placing, str(error)) from error


@body_planner.handles(PLAN_BODY_MOVE)
def plan_body(_: Task, placing: Placing) -> BodyMove:
    """Plan the body's move for the time when the leg stands."""
    try:
        return plan_body_move(placing.step, placing.foothold)
    except AmblerError as error:
        raise NO_POSE(placing, str(error)) from error


def main() -> None:
    """Run the planner that the command line names."""
    parser = program_parser("ambler_sim.modules.planners", __doc__)
    parser.add_argument("planner", choices=PLANNERS)
    PLANNERS[parser.parse_args().planner].run()


if __name__ == "__main__":
    main()
