"""The gait planner: turns an arc into steps, planning one step ahead of the one that is walked (paper, figure 2).

Each "take steps" sends its own moves and then the next "take steps", which may be planned as soon as this one is being
achieved: while step n is walked, step n+1 is planned, and never n+2.
"""

import math
from dataclasses import replace

from robots.ambler_sim.messages import (
    ACHIEVED_POSITION,
    MOVE_BODY,
    MOVE_LEG,
    NOT_THERE,
    PLAN_BODY_MOVE,
    PLAN_LEG_MOVE,
    POSITION_REACHED,
    STANCE,
    TAKE_STEPS,
    TRAVERSE_ARC,
    Ahead,
    Bend,
    Placing,
)
from robots.ambler_sim.planning.gait import TOLERANCE, after_step, next_step
from robots.ambler_sim.vocabulary import Arc, Pose, Stance
from tca_module import Module, Task, this

CLOSE_ENOUGH = 0.15
"""Metres between where the body is and where it should be after a step."""

planner = Module("gait planner")
planner.resource("position check")


class StanceMemory:
    """The last stance that was measured: feet creep a little, so it is better than what was foreseen."""

    measured: Stance | None = None

    def corrected(self, foreseen: Stance) -> Stance:
        """*foreseen* with the measured feet, but for the leg that is being moved meanwhile."""
        if self.measured is None or foreseen.last_leg < 0:
            return foreseen
        moving = foreseen.last_leg
        feet = tuple(
            there if there.leg == moving else here
            for there, here in zip(foreseen.feet, self.measured.feet, strict=True)
        )
        return replace(foreseen, feet=feet)


memory = StanceMemory()


@planner.handles(TRAVERSE_ARC)
def traverse_arc(task: Task, bend: Bend) -> None:
    """Walk a piece of path from where the robot is now."""
    stance = task.query(STANCE)
    memory.measured = stance
    task.goal(TAKE_STEPS, Ahead(Arc(stance.pose, bend.curvature, bend.length), stance))


@planner.handles(TAKE_STEPS)
def take_steps(task: Task, ahead: Ahead) -> None:
    """Plan one step and order it; leave the rest of the arc to the next "take steps"."""
    step = next_step(memory.corrected(ahead.stance), ahead.arc)
    leg_move = task.query(PLAN_LEG_MOVE, step)
    body_move = task.query(PLAN_BODY_MOVE, Placing(step, leg_move.foothold))
    with task.sequence():
        task.command(MOVE_LEG, leg_move)
        task.command(MOVE_BODY, body_move)
        task.monitor(ACHIEVED_POSITION, body_move.goal)
        if step.remaining >= TOLERANCE:
            rest = Ahead(ahead.arc, after_step(step, leg_move.foothold, body_move.goal))
            task.goal(TAKE_STEPS, rest, constraints=[task.achieving.start <= this.planning.start])


@planner.handles(POSITION_REACHED, resource="position check")
def position_reached(task: Task, goal: Pose) -> Pose:
    """Whether the body is where the step should have brought it: where it is, or a failure."""
    memory.measured = stance = task.query(STANCE)
    distance = math.hypot(stance.pose.x - goal.x, stance.pose.y - goal.y)
    if distance > CLOSE_ENOUGH:
        raise NOT_THERE(f"{distance:.2f} m", f"the body is {distance:.2f} m from where the step should have brought it")
    return stance.pose


if __name__ == "__main__":
    planner.run()
