"""The Ambler's mechanism: where shoulders and feet are, and the joint values that bring a foot to a
point.

Body frame: x forward, y left, z up; the origin is between the two shafts at the lowest shoulder. A
leg is orthogonal: it turns about its shaft (angle), reaches out (reach), and its vertical link goes
down (drop). The inverse kinematics of a leg are therefore closed-form.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robots.ambler_sim.vocabulary import LEGS, NO_LEG, Foot, Pose, Rock, Stance
from robots.plane import seen_from, world_place

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Mechanism:
    """Dimensions (m) and masses (kg). Width, mass and the six shoulder levels follow the published
    machine. *belly* is how far the body extends below the lowest shoulder.
    """

    shaft_offset: float = 1.0
    shoulder_heights: tuple[float, ...] = (0.0, 0.4, 0.8, 0.8, 0.4, 0.0)
    min_reach: float = 1.0
    max_reach: float = 2.5
    min_drop: float = 0.3
    max_drop: float = 5.0
    foot_radius: float = 0.12
    link_length: float = 4.2
    beam_length: float = 1.2
    beam_width: float = 0.25
    body_length: float = 0.95
    belly: float = 0.5
    body_mass: float = 1000.0
    body_mass_height: float = 1.0
    shoulder_mass: float = 90.0
    extension_mass: float = 70.0
    vertical_mass: float = 70.0
    foot_mass: float = 20.0
    foot_stiffness: float = 2e5
    foot_damping: float = 2e4

    @property
    def mass(self) -> float:
        """The mass (kg) of the whole robot."""
        return self.body_mass + len(LEGS) * self.leg_mass

    @property
    def leg_mass(self) -> float:
        """The mass (kg) of one leg with its foot."""
        return self.shoulder_mass + self.extension_mass + self.vertical_mass + self.foot_mass


AMBLER = Mechanism()
GRAVITY = 9.81
BODY_HEIGHT = 2.7
"""The height (m) at which the body is carried over the feet."""

TRACK = 2.3
"""The distance (m) of ideal footholds from the body's middle line."""

SHAFT_Y: Array = np.array([AMBLER.shaft_offset] * 3 + [-AMBLER.shaft_offset] * 3)
SHOULDER_Z: Array = np.array(AMBLER.shoulder_heights)


def is_left(leg: int) -> bool:
    """Return whether a leg hangs on the left shaft (0, 1, 2), not on the right one (3, 4, 5)."""
    return leg < LEGS[3]


def side_of(leg: int) -> tuple[int, ...]:
    """Return the three legs of the stack that *leg* belongs to."""
    return LEGS[:3] if is_left(leg) else LEGS[3:]


def circulation(leg: int) -> int:
    """Return the sense in which a leg always turns: left stack counter-clockwise (+1), right stack
    clockwise (-1).

    The rear-most leg comes forward between the shafts, so the order of legs within a stack never
    changes.
    """
    return 1 if is_left(leg) else -1


def unwrap(angle: float, near: float) -> float:
    """Return the angle nearest to *near* that differs from *angle* by whole turns."""
    return near + math.remainder(angle - near, math.tau)


def to_world(pose: Pose, points: Array) -> Array:
    """Convert points (n, 3) from the frame of the level body to the world."""
    x, y, z = points.T
    return np.stack([*world_place(pose.x, pose.y, pose.heading, x, y), pose.height + z], axis=1)


def to_body(pose: Pose, points: Array) -> Array:
    """Convert world points (n, 3) to the frame of the level body."""
    x, y, z = points.T
    return np.stack([*seen_from(pose.x, pose.y, pose.heading, x, y), z - pose.height], axis=1)


def offset(pose: Pose, forward: float, left: float) -> tuple[float, float]:
    """Return the world x, y of a point given relative to the body."""
    return world_place(pose.x, pose.y, pose.heading, forward, left)


def distance(here: Pose | Foot, there: Pose | Foot) -> float:
    """Return the distance (m) between two places, seen from above."""
    return math.hypot(there.x - here.x, there.y - here.y)


def seen_by(pose: Pose, place: Pose | Foot | Rock) -> tuple[float, float]:
    """Return how far ahead and to the left of the body a place is."""
    return seen_from(pose.x, pose.y, pose.heading, place.x, place.y)


def rigid_motion(before: Array, after: Array) -> tuple[float, Array]:
    """Return the turn, then the shift, that fit points *before* (n, 2) onto *after* (least
    squares).
    """
    middle_before, middle_after = before.mean(axis=0), after.mean(axis=0)
    a, b = before - middle_before, after - middle_after
    turn = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    cos, sin = math.cos(turn), math.sin(turn)
    shift: Array = middle_after - np.array([[cos, -sin], [sin, cos]]) @ middle_before
    return turn, shift


def feet_of(joints: Array, legs: Sequence[int] = LEGS) -> Array:
    """Convert (angle, reach, drop) rows of *legs* to feet in the body frame (forward
    kinematics).
    """
    index = list(legs)
    angle, reach, drop = joints.T
    return np.stack(
        [reach * np.cos(angle), SHAFT_Y[index] + reach * np.sin(angle), SHOULDER_Z[index] - drop],
        axis=1,
    )


def joints_of(feet: Array, near: Array | None = None, legs: Sequence[int] = LEGS) -> Array:
    """Convert feet in the body frame to (angle, reach, drop) rows (inverse kinematics).

    With *near* each angle is unwrapped, so that it is within half a turn of the angle in *near*.
    """
    index = list(legs)
    x, y = feet[:, 0], feet[:, 1] - SHAFT_Y[index]
    angle = np.arctan2(y, x)
    if near is not None:
        angle = near + np.remainder(angle - near + math.pi, math.tau) - math.pi
    return np.stack([angle, np.hypot(x, y), SHOULDER_Z[index] - feet[:, 2]], axis=1)


def stance_of(pose: Pose, joints: Array, last_leg: int = NO_LEG) -> Stance:
    """Return the stance of a body at *pose* with these (angle, reach, drop) rows of all legs."""
    world = to_world(pose, feet_of(joints))
    feet = tuple(Foot(leg, float(x), float(y), float(z)) for leg, (x, y, z) in enumerate(world))
    return Stance(pose, feet, last_leg)


def leg_joints(pose: Pose, foot: Foot, near: float = 0.0) -> tuple[float, float, float]:
    """Angle, reach and drop that bring one leg to *foot* while the body is at *pose*."""
    body = to_body(pose, np.array([[foot.x, foot.y, foot.z]]))
    angle, reach, drop = joints_of(body, np.array([near]), [foot.leg])[0]
    return float(angle), float(reach), float(drop)


def within_limits(joints: Array, reserve: float = 0.0) -> NDArray[np.bool_]:
    """Mask the (angle, reach, drop) rows that the links allow with *reserve* metres to spare.
    Shoulders have no limits.
    """
    parts, reach, drop = AMBLER, joints[:, 1], joints[:, 2]
    in_reach = (reach >= parts.min_reach + reserve) & (reach <= parts.max_reach - reserve)
    return in_reach & (drop >= parts.min_drop + reserve) & (drop <= parts.max_drop - reserve)


def circulating_angle(pose: Pose, foot: Foot) -> float:
    """Return how far a leg has turned from straight ahead in its own sense, 0 to 2 pi. The
    rear-most leg of a side has turned furthest.

    A leg that was stopped on its way to the front counts as rear-most until it has passed the nose.
    """
    angle, _, _ = leg_joints(pose, foot)
    return (circulation(foot.leg) * angle) % math.tau


def positions(stance: Stance) -> Array:
    """Return the six feet as an array (6, 3)."""
    return np.array([[foot.x, foot.y, foot.z] for foot in stance.feet])


def stance_joints(stance: Stance) -> Array:
    """(angle, reach, drop) of all six legs."""
    return joints_of(to_body(stance.pose, positions(stance)))
