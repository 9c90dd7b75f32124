"""The body planner: how far and how high the body goes once the foot stands."""

from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.messages import PLAN_BODY_MOVE, PLANNER_FAILED, Placing
from robots.ambler_sim.planning.body import plan_body_move
from robots.ambler_sim.vocabulary import BodyMove
from tca_module import Module, Task

planner = Module("body planner")


@planner.handles(PLAN_BODY_MOVE)
def body_move(_: Task, placing: Placing) -> BodyMove:
    """The body's part of a step."""
    try:
        return plan_body_move(placing.step, placing.foothold)
    except AmblerError as error:
        raise PLANNER_FAILED("body", str(error)) from error


if __name__ == "__main__":
    planner.run()
