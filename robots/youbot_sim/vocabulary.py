"""The nouns of a mobile manipulator: plain frozen data that can be sent as messages. Metres,
radians, seconds.
"""

from bisect import bisect_right
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate
from typing import Literal

import msgspec

Group = Literal["base", "arm", "gripper"]
"""Joints that move together: x, y, heading of the base; the arm's five angles; the gap between the
fingers.
"""

GROUPS: tuple[Group, ...] = ("base", "arm", "gripper")
Joints = tuple[float, ...]


class ObjectPlace(StrEnum):
    """Where the object is."""

    NOWHERE = "nowhere"
    OFFERED = "offered"
    """A hand holds it between the fingers, until they have closed."""
    HELD = "held"
    BOX_B = "in box B"
    BOX_C = "in box C"
    FLOOR = "on the floor"


class Move(msgspec.Struct, frozen=True, omit_defaults=True):
    """Where a group of joints is to go, by name, and with which part of its greatest speed."""

    to: str
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Drive:
    """The same for the drives: *goal* has a value for each joint."""

    group: Group
    goal: Joints
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class JointReadings:
    """The joints now, and where the object is."""

    base: Joints
    arm: Joints
    gripper: Joints
    object: ObjectPlace

    def joints(self, group: Group) -> Joints:
        """Of one group."""
        return {"base": self.base, "arm": self.arm, "gripper": self.gripper}[group]


@dataclass(frozen=True, slots=True)
class Phase:
    """A stretch of constant acceleration; *share* and *rate* are those at its beginning."""

    seconds: float
    acceleration: float
    share: float
    rate: float


@dataclass(frozen=True, slots=True)
class Motion:
    """A straight way between two sets of joint values; its *share* goes from 0 to 1."""

    start: Joints
    goal: Joints
    phases: tuple[Phase, ...]

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return sum(phase.seconds for phase in self.phases)

    def share(self, seconds: float) -> float:
        """How much of the way is done, so many seconds after its beginning."""
        return self._now(seconds)[0]

    def rate(self, seconds: float) -> float:
        """How fast the share grows then, per second."""
        return self._now(seconds)[1]

    def joints(self, seconds: float) -> Joints:
        """Where the joints are then."""
        share = self.share(seconds)
        return tuple(a + share * (b - a) for a, b in zip(self.start, self.goal, strict=True))

    def rates(self, seconds: float) -> Joints:
        """How fast the joints are then."""
        rate = self.rate(seconds)
        return tuple(rate * (b - a) for a, b in zip(self.start, self.goal, strict=True))

    def _now(self, seconds: float) -> tuple[float, float]:
        """Share and rate."""
        if not self.phases:
            return 1.0, 0.0
        begins = list(accumulate((phase.seconds for phase in self.phases), initial=0.0))
        number = max(0, min(bisect_right(begins, seconds), len(self.phases)) - 1)
        phase = self.phases[number]
        time = max(0.0, min(seconds - begins[number], phase.seconds))
        rate = phase.rate + phase.acceleration * time
        return phase.share + (phase.rate + rate) / 2 * time, rate if seconds < begins[-1] else 0.0
