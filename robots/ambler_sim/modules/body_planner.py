"""The body planner: how the body follows the leg."""

from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.messages import NO_POSE, PLAN_BODY_MOVE, Placing
from robots.ambler_sim.planning.body import plan_body_move
from robots.ambler_sim.vocabulary import BodyMove
from tca_module import Module, Task

planner = Module("body planner")


@planner.handles(PLAN_BODY_MOVE)
def body_move(_: Task, placing: Placing) -> BodyMove:
    """Where the body goes once the leg stands."""
    try:
        return plan_body_move(placing.step, placing.foothold)
    except AmblerError as error:
        raise NO_POSE(placing, str(error)) from error


if __name__ == "__main__":
    planner.run()
