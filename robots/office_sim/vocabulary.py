"""The data types of the messages: places and things of a lab, in metres. Pure."""

import math
from dataclasses import dataclass, field
from enum import StrEnum


@dataclass(frozen=True, slots=True)
class Spot:
    """A point of the floor."""

    x: float
    y: float

    def to(self, other: "Spot") -> float:
        """Return the distance to another spot."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def towards(self, other: "Spot", metres: float) -> "Spot":
        """Return the point *metres* towards another one."""
        part = metres / self.to(other)
        return Spot(self.x + part * (other.x - self.x), self.y + part * (other.y - self.y))

    def around(self, margin: float) -> "Block":
        """Return the square around it."""
        return Block(self.x, self.y, self.x, self.y).grown(margin)


@dataclass(frozen=True, slots=True)
class Block:
    """A piece of floor that a wall or a table covers."""

    left: float
    bottom: float
    right: float
    top: float

    def grown(self, by: float) -> "Block":
        """Return the piece with a margin around it."""
        return Block(self.left - by, self.bottom - by, self.right + by, self.top + by)

    def covers(self, spot: Spot) -> bool:
        """Return whether a point lies inside the block, not on its edge."""
        return self.left < spot.x < self.right and self.bottom < spot.y < self.top


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """The fixed things of the lab."""

    width: float
    depth: float
    walls: list[Block]
    tables: list[Block]
    bin: Spot
    charger: Spot

    def is_free(self, spot: Spot, margin: float) -> bool:
        """Return whether there is room of *margin* metres around a point."""
        is_inside = (
            margin <= spot.x <= self.width - margin and margin <= spot.y <= self.depth - margin
        )
        return is_inside and not any(
            block.grown(margin).covers(spot) for block in (*self.walls, *self.tables)
        )


@dataclass(frozen=True, slots=True)
class Cup:
    """A cup on the floor, with its number in vision."""

    number: int
    spot: Spot


@dataclass(frozen=True, slots=True)
class Approach:
    """A place to go to, and the distance within which it is reached."""

    spot: Spot
    within: float = 0.0


class Grasped(StrEnum):
    """The result of closing the fingers."""

    CUP = "cup"
    SLIPPED = "slipped"
    NOTHING = "nothing"


class CupState(StrEnum):
    """The place of a cup."""

    TO_COME = "to come"
    FLOOR = "on the floor"
    HAND = "in the hand"
    BIN = "in the bin"
    TAKEN = "taken by a person"


@dataclass(slots=True)
class SeenCup:
    """A cup in the picture: where it lay, and its state."""

    number: int
    spot: Spot
    state: CupState


@dataclass(slots=True)
class Stretch:
    """A part of the robot's way."""

    with_cup: bool
    points: list[Spot]


@dataclass(slots=True)
class LabScene:
    """The lab seen from above, and a text for each event so far."""

    time: float
    floor: FloorPlan
    robot: Spot
    battery: float
    charges: int
    cups: list[SeenCup] = field(default_factory=list)
    trail: list[Stretch] = field(default_factory=list)
    happened: list[str] = field(default_factory=list)
