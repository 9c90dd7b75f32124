"""The requests of the robot's user. Commands end when done; informs do not wait for earlier
commands.
"""

import msgspec

from tca_module import Command, Failure, Inform

JOINTS = ("x", "y", "tool")


class WallPoint(msgspec.Struct, frozen=True):
    """A point of the wall, in metres from its lower left corner."""

    x: float
    y: float


class JointMove(msgspec.Struct, frozen=True):
    """A move of a joint to a position, in metres."""

    joint: str
    position: float
    speed: float = 0.3


class JointSpeed(msgspec.Struct, frozen=True):
    """A move of a joint at a speed, in metres a second, until the joint is stopped or its range
    ends.
    """

    joint: str
    speed: float


ENABLE = Command("enable joints")
REFERENCE = Command("reference joints")
MOVE_TO = Command("move to", WallPoint)
MOVE_JOINT = Command("move joint", JointMove)
SET_JOINT_SPEED = Command("set joint speed", JointSpeed)
CLEAN = Command("clean wall")
STOP = Inform("stop robot")
DISABLE = Inform("disable joints")
SET_SPEED = Inform("set speed", float)
"""The speed, in metres a second, of moves in two dimensions and of cleaning."""

NOT_READY = Failure("not ready", str)
"""A joint is not enabled, not referenced, or busy."""
NO_SUCH_JOINT = Failure("no such joint", str)
INTERRUPTED = Failure("interrupted")
"""The user stopped the robot or disabled a joint."""
