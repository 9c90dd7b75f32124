"""The way of a leg between two footholds: high enough over the ground, in its stack's sense."""

import math

import numpy as np

from robots.ambler_sim.errors import OutOfReach, PathBlocked
from robots.ambler_sim.geometry import (
    AMBLER,
    SHAFT_Y,
    SHOULDER_Z,
    Array,
    circulation,
    leg_joints,
    offset,
    to_world,
    within_limits,
)
from robots.ambler_sim.planning.elevation import heights_along
from robots.ambler_sim.vocabulary import ElevationMap, Foot, LegMove, Pose, Stance, Step, Window

CLEARANCE = 0.45
"""The distance (m) between a swinging foot and the highest ground on its way."""

RECOVERY_RADIUS = 1.15
"""The usual distance (m) of a swinging foot from its shaft."""

SPACING = 0.05
"""The distance (m) between two checked points of a way."""


def window_of(step: Step) -> Window:
    """Return the ground needed to plan the way of a step's leg: all that the leg can reach."""
    x, y = offset(step.before.pose, 0.0, float(SHAFT_Y[step.leg]))
    return Window(x, y, AMBLER.max_reach + SPACING)


def plan_leg_move(ground: ElevationMap, step: Step, foothold: Foot) -> LegMove:
    """Plan the recovery of the step's leg through the body to *foothold*."""
    return plan_swing(ground, step.before, foothold, sense=circulation(step.leg))


def plan_swing(
    ground: ElevationMap,
    stance: Stance,
    foothold: Foot,
    sense: int = 0,
    radius: float | None = None,
) -> LegMove:
    """Plan a leg's move to *foothold*, turning in *sense* (0: the short way) and lifted CLEARANCE
    over everything on its way.

    The foot turns at *radius* from its shaft. The default is RECOVERY_RADIUS, or less if an end of
    the way is nearer to the shaft. Raises OutOfReach for a foothold beyond the leg's reach,
    PathBlocked if the ground is too high.
    """
    start, end = _ends(stance.pose, stance.feet[foothold.leg], foothold, sense)
    if not within_limits(np.array([end])).all():
        raise OutOfReach(
            f"leg {foothold.leg} cannot reach x {foothold.x:.2f}, y {foothold.y:.2f}:"
            f" reach {end[1]:.2f} m"
        )
    radius = radius or min(start[1], end[1], RECOVERY_RADIUS)
    lift = _highest(ground, stance.pose, foothold.leg, start, end, radius) + CLEARANCE
    require_lift(stance.pose, foothold.leg, lift)
    return LegMove(foothold.leg, foothold, lift, radius, sense)


def require_lift(pose: Pose, leg: int, lift: float) -> None:
    """Raise PathBlocked if a foot can't be lifted to this height."""
    ceiling = pose.height + float(SHOULDER_Z[leg]) - AMBLER.min_drop
    if lift > ceiling:
        raise PathBlocked(
            f"leg {leg} would have to be lifted to {lift:.2f} m, but reaches only {ceiling:.2f} m"
        )


def rotation(start: float, end: float, sense: int) -> float:
    """Return the signed angle from one direction to another in the given sense; 0 takes the short
    way.
    """
    turn = math.remainder(end - start, math.tau)
    if sense * turn < 0:
        turn += sense * math.tau
    return turn


def swing_path(
    pose: Pose, leg: int, start: tuple[float, float], end: tuple[float, float], radius: float
) -> Array:
    """World points (x, y) under a foot: retract at the first angle, rotate, extend at the last."""
    (first, reach), (last, final_reach) = start, end
    inward = _spaced(reach, radius)
    turning = _spaced(first * radius, last * radius) / radius
    outward = _spaced(radius, final_reach)
    angles = np.concatenate([np.full_like(inward, first), turning, np.full_like(outward, last)])
    radii = np.concatenate([inward, np.full_like(turning, radius), outward])
    x, y = radii * np.cos(angles), SHAFT_Y[leg] + radii * np.sin(angles)
    return to_world(pose, np.stack([x, y, np.zeros_like(x)], axis=1))[:, :2]


Joints = tuple[float, float, float]


def _ends(pose: Pose, foot: Foot, foothold: Foot, sense: int) -> tuple[Joints, Joints]:
    """Return the joints at both ends of the swing, the second angle unwrapped in the sense of
    turning.
    """
    start, end = leg_joints(pose, foot), leg_joints(pose, foothold)
    return start, (start[0] + rotation(start[0], end[0], sense), end[1], end[2])


def _highest(
    ground: ElevationMap, pose: Pose, leg: int, start: Joints, end: Joints, radius: float
) -> float:
    """Return the highest known ground on the way. Both ends count even if the map does not have
    them.
    """
    path = swing_path(pose, leg, start[:2], end[:2], radius)
    shoulder = pose.height + float(SHOULDER_Z[leg])
    heights = [
        *heights_along(ground, path[:, 0], path[:, 1]),
        shoulder - start[2],
        shoulder - end[2],
    ]
    return float(np.nanmax(heights))


def _spaced(first: float, last: float) -> Array:
    """Values from *first* to *last*, at most SPACING apart."""
    return np.linspace(first, last, 2 + int(abs(last - first) / SPACING))
