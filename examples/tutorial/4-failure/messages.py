"""The messages of the robot. All its programs import them."""

from dataclasses import dataclass

from tca_module import Command, Failure, Goal


@dataclass
class Plant:
    name: str
    room: str
    litres: float


@dataclass
class Way:
    room: str
    through: str = "hall"


BLOCKED = Failure("blocked", Way)

ROUND = Goal("round", list[Plant])
WATER = Goal("water", Plant)
DRIVE = Command("drive", Way)
FILL = Command("fill", float)
POUR = Command("pour", float)
