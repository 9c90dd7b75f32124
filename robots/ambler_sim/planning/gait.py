"""The circulating gait: which leg steps next, where it steps to, and how far the body follows.

The rear-most leg of a side swings between the shafts to the front while five legs stand. The sides
take turns. Each footstep advances the body by half a metre, as in the outdoor runs of the real
machine (500 m in 1000 footsteps). The body moves along the arc, level, at a constant height over
its feet.
"""

import math
from dataclasses import replace

import numpy as np

from robots.ambler_sim.errors import NoStep, OutOfReach, UnstableMove
from robots.ambler_sim.geometry import (
    BODY_HEIGHT,
    TRACK,
    Array,
    circulating_angle,
    circulation,
    offset,
    seen_by,
    side_of,
    stance_joints,
    within_limits,
)
from robots.ambler_sim.planning.stability import support_margin
from robots.ambler_sim.vocabulary import LEGS, NO_LEG, Arc, BodyMove, Foot, Pose, Stance, Step

ADVANCE = 0.5
"""How far (m) the body moves with a footstep, by default."""

TOLERANCE = 0.1
"""A rest of an arc shorter than this (m) is not walked."""

LOOKAHEAD = 3.0
"""How far (m) beyond the end of a course the robot aims."""

SHARPEST = 0.08
"""The greatest curvature (1/m) of an arc: standing legs must stay in reach while the body turns."""

# How far (m) before the middle of the body legs 0 to 5 stand when a left leg is about to step.
STANDARD_POSITIONS = (0.5, -0.5, -1.5, 1.0, 0.0, -1.0)

# A move of 0.5 m in under 1 s makes the machine rock on two feet. Below 0.6 m/s2 it tilts by at
# most a fifth of a degree.
ACCELERATION = 0.6
SHORTEST = 0.5
"""The least duration (s) of a body move."""

LEAST_MARGIN = 0.3
"""The least support margin (m) at the end of a body move."""

OVERREACH = 0.03
"""How far (m) beyond its limits a leg may get as feet creep. Footholds are chosen with a reserve.
"""


def next_step(stance: Stance, arc: Arc, leg: int = NO_LEG, advance: float = ADVANCE) -> Step:
    """Plan the footstep from *stance* along *arc* with *leg*, by default the leg whose turn it is.

    The body moves on by *advance*. The ideal foothold is TRACK beside the body, half way through
    the six steps for which the leg will stand. Raises NoStep at the end of the arc.
    """
    done = progress(arc, stance.pose)
    if is_finished(arc, stance.pose):
        raise NoStep(f"the arc of {arc.length:.2f} m has been walked: {done:.2f} m")
    target = min(done + advance, arc.length)
    leg = leg if leg in LEGS else next_leg(stance)
    support = tuple(
        _level_pose_on(arc, done + number * ADVANCE, stance.pose) for number in range(len(LEGS) + 1)
    )
    return Step(
        leg=leg,
        ideal=foot_beside(support[len(LEGS) // 2], leg, 0.0, mean_height(stance.feet)),
        goal=_level_pose_on(arc, target, stance.pose),
        before=stance,
        support=support,
        remaining=arc.length - target,
    )


def next_leg(stance: Stance) -> int:
    """Return the rear-most leg of the side that did not step last; at the start, of both sides."""
    candidates = (
        LEGS if stance.last_leg not in LEGS else tuple(set(LEGS) - set(side_of(stance.last_leg)))
    )
    return max(sorted(candidates), key=lambda leg: circulating_angle(stance.pose, stance.feet[leg]))


def foot_beside(pose: Pose, leg: int, ahead: float, height: float) -> Foot:
    """Return a foot TRACK to the leg's side of a body at *pose*, and *ahead* metres forward."""
    x, y = offset(pose, ahead, circulation(leg) * TRACK)
    return Foot(leg, x, y, height)


def after_step(step: Step, foothold: Foot, goal: Pose) -> Stance:
    """Return the stance after the step, with which the next step is planned while this one is
    walked.
    """
    return replace(with_foot(step.before, foothold), pose=goal, last_leg=step.leg)


def with_foot(stance: Stance, landed: Foot) -> Stance:
    """Return the stance with the foot *landed* in it."""
    return replace(
        stance, feet=tuple(landed if foot.leg == landed.leg else foot for foot in stance.feet)
    )


def progress(arc: Arc, pose: Pose) -> float:
    """Return the length (m) of the arc up to its point nearest to *pose*."""
    forward, left = seen_by(arc.start, pose)
    if abs(arc.curvature) < 1e-9:
        return forward
    turned = math.atan2(forward * arc.curvature, 1.0 - left * arc.curvature)
    # Progress may exceed half a turn: the heading gives the number of turns.
    about = pose.heading - arc.start.heading
    return (about + math.remainder(turned - about, math.tau)) / arc.curvature


def remaining(arc: Arc, pose: Pose) -> float:
    """Return the length (m) of the arc ahead of *pose*, at least 0."""
    return max(arc.length - progress(arc, pose), 0.0)


def rejoin(course: Arc, pose: Pose) -> Arc:
    """Return an arc from *pose* back to the course (pure pursuit).

    The new arc aims at a point LOOKAHEAD beyond the end of the course. It is as long as the rest of
    the course.
    """
    target = pose_on(course, course.length + LOOKAHEAD)
    x, y = target.x - pose.x, target.y - pose.y
    _, left = seen_by(pose, target)
    curvature = 2.0 * left / (x * x + y * y)
    return Arc(pose, max(-SHARPEST, min(SHARPEST, curvature)), remaining(course, pose))


def is_finished(arc: Arc, pose: Pose) -> bool:
    """Return whether the rest of an arc is too short for a step. Bodies stop early, because feet
    creep.
    """
    return remaining(arc, pose) < TOLERANCE


def pose_on(arc: Arc, distance: float) -> Pose:
    """Return the pose after *distance* metres along the arc or beyond its end."""
    turned = arc.curvature * distance
    if abs(turned) < 1e-9:
        forward, left = distance, 0.0
    else:
        forward, left = math.sin(turned) / arc.curvature, (1 - math.cos(turned)) / arc.curvature
    x, y = offset(arc.start, forward, left)
    return Pose(x, y, arc.start.heading + turned, arc.start.height)


def standard_feet(pose: Pose, height: float) -> tuple[Foot, ...]:
    """Return the standard configuration around *pose*, for the start and for recovery."""
    return tuple(
        foot_beside(pose, leg, ahead, height) for leg, ahead in enumerate(STANDARD_POSITIONS)
    )


def standard_places(stance: Stance, first: int) -> tuple[Foot, ...]:
    """Return the places of the feet in the standard configuration around the body.

    The configuration is mirrored if *first*, the leg that steps first, is on the right side. The
    three legs of a side keep their order: a leg that is half way to the front goes to the rear.
    """
    height = mean_height(stance.feet)
    places: dict[int, Foot] = {}
    for side in (LEGS[:3], LEGS[3:]):
        ahead = STANDARD_POSITIONS[:3] if first in side else STANDARD_POSITIONS[3:]
        order = sorted(side, key=lambda leg: circulating_angle(stance.pose, stance.feet[leg]))
        for leg, x in zip(order, ahead, strict=True):
            places[leg] = foot_beside(stance.pose, leg, x, height)
    return tuple(places[leg] for leg in LEGS)


def mean_height(feet: tuple[Foot, ...]) -> float:
    """Return the mean height of the ground under the feet."""
    return sum(foot.z for foot in feet) / len(feet)


def body_height(feet: tuple[Foot, ...]) -> float:
    """Return the height at which the body is carried over these feet."""
    return mean_height(feet) + BODY_HEIGHT


def _level_pose_on(arc: Arc, distance: float, now: Pose) -> Pose:
    """Return the pose after *distance* metres of the arc, at the present height of the body."""
    return replace(pose_on(arc, distance), height=now.height)


# --- how the body follows -------------------------------------------------------------------------


def plan_body_move(step: Step, foothold: Foot) -> BodyMove:
    """Return the body's part of a step whose leg now stands on *foothold*."""
    return plan_shift(after_step(step, foothold, step.before.pose), step.goal)


def plan_shift(stance: Stance, goal: Pose) -> BodyMove:
    """Plan a body move to the x, y and heading of *goal*, at the right height over the feet of
    *stance*.

    Raises OutOfReach or UnstableMove if the feet do not allow it.
    """
    goal = replace(goal, height=body_height(stance.feet))
    there = replace(stance, pose=goal)
    require_reach(stance_joints(there), OVERREACH)
    margin = support_margin(there)
    if margin < LEAST_MARGIN:
        raise UnstableMove(
            f"the body at x {goal.x:.2f}, y {goal.y:.2f} would be {margin:.2f} m from tipping;"
            f" the least is {LEAST_MARGIN} m"
        )
    return BodyMove(goal, duration(stance.pose, goal))


def duration(start: Pose, goal: Pose) -> float:
    """Return the seconds for a cosine profile that peaks at ACCELERATION. Turning counts at 2 m
    radius.
    """
    turn = 2.0 * (goal.heading - start.heading)
    distance = math.hypot(goal.x - start.x, goal.y - start.y, goal.height - start.height, turn)
    return max(SHORTEST, math.pi * math.sqrt(distance / (2 * ACCELERATION)))


def require_reach(joints: Array, tolerance: float = 0.0) -> None:
    """Raise OutOfReach if a leg's joints are more than *tolerance* metres beyond its limits."""
    fit = within_limits(joints, -tolerance)
    if not fit.all():
        leg = int(np.argmin(fit))
        _, reach, drop = joints[leg]
        raise OutOfReach(f"leg {leg} would need reach {reach:.2f} m, drop {drop:.2f} m")
