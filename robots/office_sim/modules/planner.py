"""The planner: how a cup gets into the bin, and how the robot gets to a place."""

from robots.office_sim.messages import (
    COLLECT_CUP,
    DROP,
    FLOOR_PLAN,
    FOLLOW_PATH,
    GRASP,
    HELD_CUP,
    LET_GO,
    NAVIGATE,
    NO_WAY,
    REACH,
    ROBOT_SPOT,
)
from robots.office_sim.paths import NoPath, path_to
from robots.office_sim.program import run
from robots.office_sim.vocabulary import Approach, Cup
from tca_module import Module, Task


def make_module(_: float) -> Module:
    """Make the module."""
    planner = Module("planner")

    @planner.handles(COLLECT_CUP)
    def collect_cup(task: Task, cup: Cup) -> None:
        task.on_termination(LET_GO, cup.number)
        if task.query(HELD_CUP) != cup.number:
            task.goal(NAVIGATE, Approach(cup.spot, REACH), delay_planning=True)
            task.command(GRASP, cup)
        task.goal(NAVIGATE, Approach(task.query(FLOOR_PLAN).bin, REACH), delay_planning=True)
        task.command(DROP)

    @planner.handles(NAVIGATE)
    def navigate(task: Task, wanted: Approach) -> None:
        """Plan the way when it is time to drive, from the robot's place at that time."""
        try:
            way = path_to(task.query(FLOOR_PLAN), task.query(ROBOT_SPOT), wanted)
        except NoPath as error:
            raise NO_WAY(wanted, str(error)) from error
        task.command(FOLLOW_PATH, way)

    return planner


if __name__ == "__main__":
    run(make_module)
