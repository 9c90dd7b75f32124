"""What the simulator of a turtle understands, and tells. Each turtle has its own central, so no
name says which.
"""

from dataclasses import dataclass, field

from robots.turtle_sim.world import Pen, Pose, Stroke
from tca_module import Command, Inform, Query, Variable


@dataclass
class Velocity:
    """How fast to move ahead (units a second) and to turn left (radians a second)."""

    linear: float = 0.0
    angular: float = 0.0


@dataclass
class SeenTurtle:
    """What is to be seen of a turtle."""

    pose: Pose
    pen: Pen


@dataclass
class Sheet:
    """All that is to be seen."""

    strokes: list[Stroke] = field(default_factory=list)
    turtles: dict[str, SeenTurtle] = field(default_factory=dict)


POSE = Variable("pose", Pose)
VELOCITY = Inform("velocity", Velocity)
CHANGE_PEN = Command("change pen", Pen)
CLEAR_SHEET = Command("clear sheet")
SHEET = Query("sheet", reply=Sheet)
