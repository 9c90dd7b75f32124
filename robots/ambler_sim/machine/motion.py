"""Smooth motion: the phases of a leg move as joint segments with cosine profiles. No simulator."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from robots.ambler_sim.geometry import SHOULDER_Z, Array, leg_joints
from robots.ambler_sim.planning.leg_recovery import rotation
from robots.ambler_sim.vocabulary import LegMove, Pose

SPEEDS: Array = np.array([3.0, 1.2, 1.6])
"""Greatest speeds of angle (rad/s), reach and drop (m/s)."""

ACCELERATIONS: Array = np.array([6.0, 6.0, 12.0])
"""Greatest accelerations (rad/s2, m/s2). With more, a foot would feel its own inertia as an
obstacle.
"""

SHORTEST = 0.1
"""The least duration (s) of a segment."""

GUARD = 0.15
"""The height (m) above the expected ground from which a foot is lowered slowly."""

GUARDED_SPEED = 0.25
HURRIED_SPEED = 1.0
"""The speeds (m/s) at which a foot is lowered: usually, and while the body tilts."""

TOUCH_LOAD = 1500.0
"""A foot with at least this vertical force (N) stands."""

HANGING_LOAD = 500.0
"""A foot with less than this vertical force (N) does not stand."""

CONTACT_FORCE = 800.0
"""A lifted foot with this sideways force (N) has met something. A free swing causes half of it at
most.
"""

BACK_OFF = 0.25
"""How far (m) a foot moves back from an obstacle before it is put down."""


ROTATING = 2
"""The index of the segment of a leg move that swings the lifted foot around the shaft."""


@dataclass(frozen=True, eq=False)
class Segment:
    """A motion of one leg's joints from *start* to *end* in *duration* seconds."""

    start: Array
    end: Array
    duration: float

    def at(self, share: float) -> Array:
        """Return the joints when *share* (0 to 1) of the time has passed."""
        joints: Array = self.start + ease(share) * (self.end - self.start)
        return joints


def ease(share: float) -> float:
    """Return a cosine from 0 to 1 with speed 0 at both ends."""
    return (1 - math.cos(math.pi * min(share, 1.0))) / 2


def leg_segments(move: LegMove, pose: Pose, joints: Array) -> list[Segment]:
    """Return the segments of a leg move from the present *joints*: lift, retract, rotate, extend,
    and lower to GUARD above the expected ground.
    """
    angle, reach, drop = leg_joints(pose, move.foothold)
    first, _, standing = joints
    last = first + rotation(first, angle, move.sense)
    lifted = min(pose.height + float(SHOULDER_Z[move.leg]) - move.lift, standing)
    corners = [
        joints,
        np.array([first, joints[1], lifted]),
        np.array([first, move.radius, lifted]),
        np.array([last, move.radius, lifted]),
        np.array([last, reach, lifted]),
        np.array([last, reach, max(drop - GUARD, lifted)]),
    ]
    return [make_segment(a, b) for a, b in itertools.pairwise(corners)]


def back_off(segment: Segment, share: float) -> Segment:
    """Return the way back from *share* of a segment: BACK_OFF long, or to the segment's start."""
    here = segment.at(share)
    while share > 0 and _distance(segment.at(share), here) < BACK_OFF:
        share = max(share - 0.01, 0.0)
    return make_segment(here, segment.at(share))


def _distance(first: Array, second: Array) -> float:
    """Return the distance of a foot's places at two (angle, reach, drop) of one leg."""
    (a, r, d), (b, s, e) = first, second
    return math.dist((r * math.cos(a), r * math.sin(a), d), (s * math.cos(b), s * math.sin(b), e))


def make_segment(start: Array, end: Array) -> Segment:
    """Make the quickest allowed segment.

    A cosine profile peaks at pi/2 of its mean speed and pi^2/2 of its mean acceleration.
    """
    way = np.abs(end - start)
    least_for_speed = math.pi / 2 * float((way / SPEEDS).max())
    least_for_acceleration = math.pi * math.sqrt(float((way / ACCELERATIONS).max()) / 2)
    return Segment(start, end, max(least_for_speed, least_for_acceleration, SHORTEST))


def blend(start: Pose, goal: Pose, share: float) -> Pose:
    """Interpolate two poses; the heading turns the short way."""
    turn = math.remainder(goal.heading - start.heading, math.tau)
    return Pose(
        start.x + share * (goal.x - start.x),
        start.y + share * (goal.y - start.y),
        start.heading + share * turn,
        start.height + share * (goal.height - start.height),
    )
