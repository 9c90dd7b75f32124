"""Motions within limits: each is as fast as its slowest joint, and all joints arrive together."""

import math
from collections.abc import Iterable

from robots.youbot_sim.vocabulary import Drive, Group, Joints, Motion, Phase

SPEEDS: dict[Group, Joints] = {"base": (0.6, 0.6, 0.8), "arm": (0.9,) * 5, "gripper": (0.02,)}
"""Greatest speeds, below the robot's own (0.8 m/s, 1.57 rad/s), because it carries an object."""

ACCELERATIONS: dict[Group, Joints] = {"base": (0.6, 0.6, 0.8), "arm": (1.5,) * 5, "gripper": (0.1,)}

REST = 1e-9
"""A shorter way counts as no way."""


def plan(drive: Drive, start: Joints, rate: float = 0.0) -> Motion:
    """Plan the motion to the goal from the joint values *start*. *rate* is the present speed, in
    shares of the way to the goal per second.
    """
    way = [abs(b - a) for a, b in zip(start, drive.goal, strict=True)]
    if max(way) < REST:
        return Motion(start, drive.goal, ())
    fastest = drive.speed * _lowest_limit(way, SPEEDS[drive.group])
    strongest = _lowest_limit(way, ACCELERATIONS[drive.group])
    if rate > fastest:  # the speed was reduced on the way
        peak, first = fastest, ((rate - fastest) / strongest, -strongest)
    else:
        peak = min(fastest, math.sqrt(strongest + rate * rate / 2))
        first = (peak - rate) / strongest, strongest
    left = 1 - abs(peak * peak - rate * rate) / (2 * strongest) - peak * peak / (2 * strongest)
    cruise = (max(left, 0.0) / peak, 0.0)
    return Motion(start, drive.goal, _phases(rate, [first, cruise, (peak / strongest, -strongest)]))


def change_speed(motion: Motion, seconds: float, drive: Drive) -> Motion:
    """Return the motion that continues *motion* to the same goal with the speed of *drive*."""
    share = motion.share(seconds)
    return plan(
        drive, motion.joints(seconds), motion.rate(seconds) / (1 - share) if share < 1 else 0.0
    )


def halt(motion: Motion, seconds: float, group: Group) -> Motion:
    """Return the motion that brings the joints to rest on their way, as quickly as is allowed."""
    rate, start = motion.rate(seconds), motion.joints(seconds)
    if not rate:
        return Motion(start, start, ())
    way = [abs(b - a) for a, b in zip(motion.start, motion.goal, strict=True)]
    seconds_left = rate / _lowest_limit(way, ACCELERATIONS[group])
    braking_way = rate * seconds_left / 2
    goal = tuple(
        a + braking_way * (b - c) for a, b, c in zip(start, motion.goal, motion.start, strict=True)
    )
    return Motion(start, goal, (Phase(seconds_left, -2 / seconds_left**2, 0.0, 2 / seconds_left),))


def _lowest_limit(way: Iterable[float], limits: Joints) -> float:
    """Return the limit of the joint that needs the longest, in shares of the way."""
    return min(limit / length for length, limit in zip(way, limits, strict=True) if length > REST)


def _phases(rate: float, accelerations: Iterable[tuple[float, float]]) -> tuple[Phase, ...]:
    share, phases = 0.0, []
    for seconds, acceleration in accelerations:
        if seconds > 0:
            phases.append(Phase(seconds, acceleration, share, rate))
            share += rate * seconds + acceleration * seconds * seconds / 2
            rate += acceleration * seconds
    return tuple(phases)
