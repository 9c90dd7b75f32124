"""The messages of a turtle's simulator. Each turtle has its own central, so no message names it."""

from dataclasses import dataclass, field

from robots.turtle_sim.world import Pen, Pose, Stroke
from tca_module import Command, Inform, Query, Variable


@dataclass
class Velocity:
    """The speed ahead (units a second) and the turn to the left (radians a second)."""

    linear: float = 0.0
    angular: float = 0.0


@dataclass
class SeenTurtle:
    """The visible state of a turtle."""

    pose: Pose
    pen: Pen


@dataclass
class Sheet:
    """The visible state of the sheet: strokes and turtles."""

    strokes: list[Stroke] = field(default_factory=list)
    turtles: dict[str, SeenTurtle] = field(default_factory=dict)


POSE = Variable("pose", Pose)
VELOCITY = Inform("velocity", Velocity)
CHANGE_PEN = Command("change pen", Pen)
CLEAR_SHEET = Command("clear sheet")
SHEET = Query("sheet", reply=Sheet)
