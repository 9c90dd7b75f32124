"""The arm: where its fingertips are, and the joint angles that bring them to a place. Closed forms,
without a simulator.

Angles are zero where the arm is upright; positive ones lean it forward. The joints are those of the
data sheet: one turns the arm, three lean it, and one turns the gripper.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from robots.plane import world_place
from robots.youbot_sim.vocabulary import Joints

MOUNT = 0.167
"""The distance (m) of the arm's axis ahead of the base's centre."""

SHOULDER_AHEAD, SHOULDER_HEIGHT = 0.033, 0.245
UPPER, FORE, HAND = 0.155, 0.135, 0.2175
"""Lengths of upper arm, forearm, and hand with gripper up to the fingertips."""

LIMITS = tuple(
    (math.radians(low), math.radians(high))
    for low, high in (
        (-169.0, 169.0),
        (-65.0, 90.0),
        (-151.0, 146.0),
        (-102.5, 102.5),
        (-167.5, 167.5),
    )
)


class PoseUnreachable(Exception):
    """The arm can't reach a pose."""


@dataclass(frozen=True, slots=True)
class Grip:
    """A pose of the fingertips relative to the arm's axis.

    *azimuth* is the angle to the left, *reach* the distance ahead, *height* that above the floor.
    *lean* is the angle of the hand (0 upright, pi straight down).
    """

    azimuth: float
    reach: float
    height: float
    lean: float


def chain(joints: Joints) -> Iterator[tuple[float, float]]:
    """Yield the distance ahead of the arm's axis, and the height, of shoulder, elbow, wrist and
    fingertips.
    """
    ahead, up, lean = SHOULDER_AHEAD, SHOULDER_HEIGHT, 0.0
    yield ahead, up
    for length, angle in zip((UPPER, FORE, HAND), joints[1:4], strict=True):
        lean += angle
        ahead, up = ahead + length * math.sin(lean), up + length * math.cos(lean)
        yield ahead, up


def grip_of(joints: Joints) -> Grip:
    """Return the pose of the fingertips."""
    *_, (reach, height) = chain(joints)
    return Grip(joints[0], reach, height, sum(joints[1:4]))


def joints_for(grip: Grip) -> Joints:
    """Return the joint angles for a pose, with the elbow up. Raises PoseUnreachable."""
    ahead = grip.reach - SHOULDER_AHEAD - HAND * math.sin(grip.lean)
    up = grip.height - SHOULDER_HEIGHT - HAND * math.cos(grip.lean)
    bend = (ahead * ahead + up * up - UPPER * UPPER - FORE * FORE) / (2 * UPPER * FORE)
    if not -1 <= bend <= 1:
        raise PoseUnreachable(
            f"{grip} is out of reach:"
            f" the wrist would be {math.hypot(ahead, up):.3f} m from the shoulder"
        )
    elbow = math.acos(bend)
    shoulder = math.atan2(ahead, up) - math.atan2(FORE * math.sin(elbow), UPPER + FORE * bend)
    joints = (grip.azimuth, shoulder, elbow, grip.lean - shoulder - elbow, 0.0)
    for number, (angle, (low, high)) in enumerate(zip(joints, LIMITS, strict=True), start=1):
        if not low <= angle <= high:
            raise PoseUnreachable(
                f"{grip} is out of reach:"
                f" joint {number} can't turn to {math.degrees(angle):.0f} degrees"
            )
    return joints


def tip_in_world(base: Joints, arm: Joints) -> tuple[float, float, float]:
    """Return the fingertips in the world, for a base at x, y, heading."""
    grip = grip_of(arm)
    ahead, left = MOUNT + grip.reach * math.cos(grip.azimuth), grip.reach * math.sin(grip.azimuth)
    return *world_place(base[0], base[1], base[2], ahead, left), grip.height
