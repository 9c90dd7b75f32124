"""The data types of a mobile manipulator, to send as messages. Metres, radians, seconds."""

from bisect import bisect_right
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate
from typing import Literal

import msgspec

Group = Literal["base", "arm", "gripper"]
"""Joints that move together: the base's x, y, heading; the arm's five angles; the fingers' gap."""

GROUPS: tuple[Group, ...] = ("base", "arm", "gripper")
Joints = tuple[float, ...]


class ObjectPlace(StrEnum):
    """The place of the object."""

    NOWHERE = "nowhere"
    OFFERED = "offered"
    """A user's hand holds the object between the fingers, until the fingers have closed."""
    HELD = "held"
    BOX_B = "in box B"
    BOX_C = "in box C"
    FLOOR = "on the floor"


class Move(msgspec.Struct, frozen=True, omit_defaults=True):
    """A named goal for a group of joints, and the share of its greatest speed."""

    to: str
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Drive:
    """A move for the drives: *goal* has a value for each joint."""

    group: Group
    goal: Joints
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class JointReadings:
    """The present joint values, and the place of the object."""

    base: Joints
    arm: Joints
    gripper: Joints
    object: ObjectPlace

    def joints(self, group: Group) -> Joints:
        """Return the joint values of one group."""
        return {"base": self.base, "arm": self.arm, "gripper": self.gripper}[group]


@dataclass(frozen=True, slots=True)
class Phase:
    """A phase of constant acceleration. *share* and *rate* are the values at its start."""

    seconds: float
    acceleration: float
    share: float
    rate: float


@dataclass(frozen=True, slots=True)
class Motion:
    """A straight way between two sets of joint values. Its *share* grows from 0 to 1."""

    start: Joints
    goal: Joints
    phases: tuple[Phase, ...]

    @property
    def seconds(self) -> float:
        """The duration."""
        return sum(phase.seconds for phase in self.phases)

    def share(self, seconds: float) -> float:
        """Return the share of the way done *seconds* after its start."""
        return self._share_and_rate(seconds)[0]

    def rate(self, seconds: float) -> float:
        """Return the speed of the share at that time, per second."""
        return self._share_and_rate(seconds)[1]

    def joints(self, seconds: float) -> Joints:
        """Return the joint values at that time."""
        share = self.share(seconds)
        return tuple(a + share * (b - a) for a, b in zip(self.start, self.goal, strict=True))

    def rates(self, seconds: float) -> Joints:
        """Return the joint speeds at that time."""
        rate = self.rate(seconds)
        return tuple(rate * (b - a) for a, b in zip(self.start, self.goal, strict=True))

    def _share_and_rate(self, seconds: float) -> tuple[float, float]:
        """Return the share of the way done *seconds* after the start, and its speed."""
        if not self.phases:
            return 1.0, 0.0
        begins = list(accumulate((phase.seconds for phase in self.phases), initial=0.0))
        number = max(0, min(bisect_right(begins, seconds), len(self.phases)) - 1)
        phase = self.phases[number]
        time = max(0.0, min(seconds - begins[number], phase.seconds))
        rate = phase.rate + phase.acceleration * time
        return phase.share + (phase.rate + rate) / 2 * time, rate if seconds < begins[-1] else 0.0
