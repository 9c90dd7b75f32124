"""Smooth motion: the phases of a leg move as joint segments with cosine profiles. No simulator in
here.
"""

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
"""Greatest accelerations (rad/s2, m/s2): a foot that is jerked aside feels forces as if it met
something.
"""

SHORTEST = 0.1
GUARD = 0.15
GUARDED_SPEED = 0.25
HURRIED_SPEED = 1.0
"""How fast (m/s) a foot is lowered, and how fast when the body tilts."""

TOUCH_LOAD = 1500.0
"""A foot with this vertical force (N) stands."""

HANGING_LOAD = 500.0
"""A foot that bears less (N) does not stand."""

CONTACT_FORCE = 800.0
"""A lifted foot that is pushed aside with this force (N) has met something; swinging freely it
feels at most half.
"""

BACK_OFF = 0.25
"""How far (m) a foot goes back from what it met before it is put down."""


ROTATING = 2
"""Which of the segments of a leg move swings the lifted foot around the shaft."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One leg's joints go from *start* to *end* in *duration* seconds."""

    start: Array
    end: Array
    duration: float

    def at(self, share: float) -> Array:
        """The joints when *share* (0 to 1) of the time has passed."""
        joints: Array = self.start + ease(share) * (self.end - self.start)
        return joints


def ease(share: float) -> float:
    """A cosine from 0 to 1 with no speed at both ends."""
    return (1 - math.cos(math.pi * min(share, 1.0))) / 2


def leg_segments(move: LegMove, pose: Pose, joints: Array) -> list[Segment]:
    """Lift, retract, rotate, extend and lower until GUARD above the expected ground, from the
    present *joints*.
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
    """The way back from where *share* of a segment has been done, until the foot is BACK_OFF away
    or at its start.
    """
    here = segment.at(share)
    while share > 0 and _distance(segment.at(share), here) < BACK_OFF:
        share = max(share - 0.01, 0.0)
    return make_segment(here, segment.at(share))


def _distance(first: Array, second: Array) -> float:
    """Between a foot's places at two (angle, reach, drop) of one leg."""
    (a, r, d), (b, s, e) = first, second
    return math.dist((r * math.cos(a), r * math.sin(a), d), (s * math.cos(b), s * math.sin(b), e))


def make_segment(start: Array, end: Array) -> Segment:
    """As quick as is allowed; a cosine profile peaks at pi/2 of its mean speed, and pi^2/2 of its
    mean acceleration.
    """
    way = np.abs(end - start)
    slowest, laziest = float((way / SPEEDS).max()), float((way / ACCELERATIONS).max())
    return Segment(
        start, end, max(slowest * math.pi / 2, math.pi * math.sqrt(laziest / 2), SHORTEST)
    )


def blend(start: Pose, goal: Pose, share: float) -> Pose:
    """A pose between two; the heading goes the short way."""
    turn = math.remainder(goal.heading - start.heading, math.tau)
    return Pose(
        start.x + share * (goal.x - start.x),
        start.y + share * (goal.y - start.y),
        start.heading + share * turn,
        start.height + share * (goal.height - start.height),
    )
