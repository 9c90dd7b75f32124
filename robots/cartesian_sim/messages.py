"""What the robot's user may ask for. Commands end when they are done; informs wait for no command
before them.
"""

import msgspec

from tca_module import Command, Failure, Inform

JOINTS = ("x", "y", "tool")


class WallPoint(msgspec.Struct, frozen=True):
    """A point of the wall, in metres from its lower left corner."""

    x: float
    y: float


class JointMove(msgspec.Struct, frozen=True):
    """Move a joint to a position, in metres."""

    joint: str
    position: float
    speed: float = 0.3


class JointSpeed(msgspec.Struct, frozen=True):
    """Move a joint at a speed, in metres a second, until it is told to stop or its range ends."""

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
"""Of moves in two dimensions, and of cleaning, in metres a second."""

NOT_READY = Failure("not ready", str)
"""A joint that is not enabled, not referenced, or busy."""
NO_SUCH_JOINT = Failure("no such joint", str)
INTERRUPTED = Failure("interrupted")
"""Somebody stopped the robot, or a joint was disabled."""
