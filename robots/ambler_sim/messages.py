"""The messages between the Ambler's modules. Their data types are in vocabulary.py."""

from dataclasses import dataclass

from robots.ambler_sim.vocabulary import (
    Arc,
    BodyMove,
    Contact,
    ElevationMap,
    Fault,
    Foot,
    Footfall,
    Image,
    LegMove,
    Obstacle,
    Pose,
    Readings,
    Scan,
    Stance,
    Step,
    Window,
)
from tca_module import Broadcast, Command, Failure, Goal, Inform, PointMonitor, Query, Variable


@dataclass(frozen=True, slots=True)
class Bend:
    """A piece of path from the robot's place: *length* metres, to the left if *curvature* > 0."""

    curvature: float
    length: float


@dataclass(frozen=True, slots=True)
class Path:
    """Pieces to walk one after the other. With *ask* the operator confirms each piece but the
    first.
    """

    bends: tuple[Bend, ...]
    ask: bool = False


@dataclass(frozen=True, slots=True)
class WayWalked:
    """How far the robot has come on a path: as text, and as a share of the path."""

    text: str
    share: float


@dataclass(frozen=True, slots=True)
class Ahead:
    """The rest of an arc, the stance foreseen at its start (not measured), and the number of its
    first footstep.
    """

    arc: Arc
    stance: Stance
    number: int


@dataclass(frozen=True, slots=True)
class StepEnd:
    """The pose in which the body should be after the footstep with this number."""

    number: int
    goal: Pose


@dataclass(frozen=True, slots=True)
class Placing:
    """A step and the foothold chosen for it."""

    step: Step
    foothold: Foot


@dataclass(frozen=True, slots=True)
class Reset:
    """A request to switch on a leg's amplifier or to free its joint. With *operator* a person does
    that by hand.
    """

    leg: int
    operator: bool = False


@dataclass(frozen=True, slots=True)
class MotionError:
    """A leg whose joint lags behind its command, and by how much (m or rad)."""

    leg: int
    error: float


# The task tree of the paper's figure 2, from the top down.
TRAVERSE_PATH = Goal("traverse path", Path, progress=WayWalked)
CONFIRM_ARC = Command("confirm arc", int)
TRAVERSE_ARC = Goal("traverse arc", Arc)
TAKE_STEPS = Goal("take steps", Ahead)
MOVE_LEG = Command("move leg", LegMove, result=Footfall)
MOVE_BODY = Command("move body", BodyMove, result=Pose)
WALKED = Broadcast("walked", Pose)
POSITION_REACHED = Query("position reached", StepEnd, reply=Pose)
ACHIEVED_POSITION = PointMonitor(
    "achieved position?", StepEnd, condition=POSITION_REACHED, action=WALKED
)

# Queries of and to the planners.
ELEVATION_MAP = Query("elevation map", Window, reply=ElevationMap)
PLAN_FOOTFALL = Query("plan footfall", Step, reply=Foot)
PLAN_LEG_RECOVERY = Query("plan leg recovery", Placing, reply=LegMove)
PLAN_BODY_MOVE = Query("plan body move", Placing, reply=BodyMove)

# Queries to the controller.
STANCE = Query("stance", reply=Stance)
READINGS = Query("readings", reply=Readings)
PICTURE = Query("picture", str, reply=str)
RANGES = Query("ranges", reply=Scan)

# SVG. Pages show variables whose names begin with "picture of".
ROBOT_PICTURE = Variable("picture of the Ambler", str)

# Repairs and faults of the machine.
RESET = Command("reset", Reset)
FREE_JOINT = Command("free joint", Reset)
CALIBRATE = Command("calibrate", int)
LEVEL_BODY = Command("level body")
INJECT = Command("inject", Fault)
FAULT_BEGAN = Broadcast("fault began", Fault)
LOSE_PROGRAM = Command("lose program", str)

# Perception: images numbered by footsteps, the map built from them, and obstacles that legs felt.
ACQUIRE_IMAGE = Command("acquire image", int)
IMAGES = Query("images", int, reply=tuple[Image, ...])
UPDATE_MAP = Command("update map")
FELT = Inform("felt", Obstacle)
FORGET_FELT = Inform("forget what was felt")

NO_FOOTFALL = Failure("no footfall", Step)
NO_PATH = Failure("no path", Placing)
NO_POSE = Failure("no pose", Placing)
NO_IMAGE = Failure("no image", int)
BAD_IMAGE = Failure("bad image", int)
AMPLIFIER_TRIPPED = Failure("amplifier tripped", int)
NEEDS_OPERATOR = Failure("needs operator", int)
JOINT_FAULT = Failure("joint fault", MotionError)
TERRAIN_COLLISION = Failure("terrain collision", Contact)
TIP_OVER_RISK = Failure("tip-over risk", float)
MOTION_FAULT = Failure("motion fault", str)
NOT_THERE = Failure("position not achieved", str)
