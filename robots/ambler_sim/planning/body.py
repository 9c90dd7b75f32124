"""How the body follows: forward along the arc, level, at a constant height over its feet."""

import math
from dataclasses import replace

import numpy as np

from robots.ambler_sim.errors import OutOfReach, UnstableMove
from robots.ambler_sim.geometry import Array, stance_joints, within_limits
from robots.ambler_sim.planning.gait import after_step, body_height
from robots.ambler_sim.planning.stability import support_margin
from robots.ambler_sim.vocabulary import BodyMove, Foot, Pose, Stance, Step

# 0.5 m in under 1 s makes the machine rock on two feet; below 0.6 m/s2 it stays within a fifth of a degree.
ACCELERATION = 0.6
SHORTEST = 0.5
LEAST_MARGIN = 0.3
TOLERANCE = 0.03
"""How far (m) beyond the limits a leg may get when its foot has crept; footholds are chosen with some reserve."""


def plan_body_move(step: Step, foothold: Foot) -> BodyMove:
    """The body's part of a step whose leg now stands on *foothold*."""
    return plan_shift(after_step(step, foothold, step.before.pose), step.goal)


def plan_shift(stance: Stance, goal: Pose) -> BodyMove:
    """Move the body to the x, y, heading of *goal* at the right height over the feet of *stance*.

    Raises OutOfReach or UnstableMove when the feet do not allow it.
    """
    goal = replace(goal, height=body_height(stance.feet))
    there = replace(stance, pose=goal)
    require_reach(stance_joints(there), TOLERANCE)
    margin = support_margin(there)
    if margin < LEAST_MARGIN:
        message = f"the body at x {goal.x:.2f}, y {goal.y:.2f} would be {margin:.2f} m from tipping, not {LEAST_MARGIN}"
        raise UnstableMove(message)
    return BodyMove(goal, duration(stance.pose, goal))


def duration(start: Pose, goal: Pose) -> float:
    """Seconds for a cosine profile whose greatest acceleration is ACCELERATION; turning counts at 2 m radius."""
    turn = 2.0 * (goal.heading - start.heading)
    distance = math.hypot(goal.x - start.x, goal.y - start.y, goal.height - start.height, turn)
    return max(SHORTEST, math.pi * math.sqrt(distance / (2 * ACCELERATION)))


def require_reach(joints: Array, tolerance: float = 0.0) -> None:
    """Raise OutOfReach when some leg's (angle, reach, drop) is more than *tolerance* metres beyond its limits."""
    fit = within_limits(joints, -tolerance)
    if not fit.all():
        leg = int(np.argmin(fit))
        _, reach, drop = joints[leg]
        message = f"leg {leg} would need reach {reach:.2f} m, drop {drop:.2f} m"
        raise OutOfReach(message)
