"""The data types of a walking Ambler: plain frozen data, sent as messages and saved as JSON.

World frame: x forward at the start, y left, z up. Units: metres, radians, seconds, newtons.
"""

from dataclasses import dataclass

LEGS = (0, 1, 2, 3, 4, 5)
NO_LEG = -1

MACHINE_KINDS = ("amplifier trip", "motion fault", "stuck joint", "encoder drift", "force sensor")
SCANNER_KINDS = ("no image", "bad image")
GROUND_KINDS = ROCK, SOFT_SPOT = "unseen rock", "soft spot"
KINDS = (
    *MACHINE_KINDS,
    *SCANNER_KINDS,
    *GROUND_KINDS,
    "no footfall",
    "lost module",
    "lost central",
)
"""Kinds of faults: of the machine, the scanner, the ground, planners and programs."""

TERRAINS = ("flat", "rolling", "hills", "boulders", "ditches", "soft")


@dataclass(frozen=True, slots=True)
class Pose:
    """The pose of the (level) body: of the point between the shafts at the lowest shoulder."""

    x: float
    y: float
    heading: float
    height: float


ORIGIN = Pose(0.0, 0.0, 0.0, 0.0)
"""The start of each walk; the ground gives its height."""


@dataclass(frozen=True, slots=True)
class Foot:
    """The lowest point of a leg's foot in the world."""

    leg: int
    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class Stance:
    """Six feet in leg order, the body above them, and the leg that took the last complete step."""

    pose: Pose
    feet: tuple[Foot, ...]
    last_leg: int = NO_LEG


@dataclass(frozen=True, slots=True)
class Arc:
    """A path for the body: *length* metres from *start*, to the left if *curvature* (1/m) is
    positive.
    """

    start: Pose
    curvature: float
    length: float


@dataclass(frozen=True, slots=True)
class Step:
    """One footstep: *leg* goes to about *ideal*, then the body to *goal*.

    The new foothold must stay in reach during the body poses *support*: from now until the foot is
    lifted. *remaining* metres of the arc are left after the step. The height of *goal* is not yet
    known (see gait.py).
    """

    leg: int
    ideal: Foot
    goal: Pose
    before: Stance
    support: tuple[Pose, ...]
    remaining: float


@dataclass(frozen=True, slots=True)
class LegMove:
    """A move of a leg: lift the foot to world height *lift*, retract it to *radius*, rotate, extend
    it over *foothold*, lower it until it stands.

    *sense*: +1 rotates counter-clockwise seen from above, -1 clockwise, 0 the short way.
    """

    leg: int
    foothold: Foot
    lift: float
    radius: float
    sense: int


@dataclass(frozen=True, slots=True)
class BodyMove:
    """A move of the body to *goal* in *duration* seconds. All feet stay where they are."""

    goal: Pose
    duration: float


@dataclass(frozen=True, slots=True)
class Footfall:
    """The result of a leg move. *load* is vertical; *reached* is false if the move was stopped."""

    foot: Foot
    load: float
    reached: bool


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact of a moving leg: the place of its foot, the force (N) that stopped it, and the
    direction of its move.

    The direction is a unit vector; it is zero if the leg went down. Leg -1 stands for the body. The
    place is then the body's front.
    """

    leg: int
    x: float
    y: float
    z: float
    force: float
    dx: float = 0.0
    dy: float = 0.0


@dataclass(frozen=True, slots=True)
class ElevationMap:
    """Ground heights in square cells; x grows with the row, y with the column.

    *x*, *y* is the centre of the first cell. *heights* holds rows*columns float32 values, NaN where
    nothing is known nearby. *known* has one byte per cell: 1 measured, 0 filled in. Read them with
    elevation.heights_of and known_cells.
    """

    x: float
    y: float
    resolution: float
    rows: int
    columns: int
    heights: bytes
    known: bytes


@dataclass(frozen=True, slots=True)
class Scan:
    """A range image as world points (n*3 float32), and the stance in which it was taken."""

    stance: Stance
    points: bytes


@dataclass(frozen=True, slots=True)
class Rock:
    """An upright stone that the scanner does not see; its top is *height* above the ground around
    it.
    """

    x: float
    y: float
    radius: float
    height: float


@dataclass(frozen=True, slots=True)
class TerrainSpec:
    """The data that define a ground.

    They are the kind of ground (one of TERRAINS), the steepest gradient (rise per run), the rocks,
    and the places (x, y) where ground gave way.
    """

    seed: int = 1
    slope: float = 0.10
    rocks: tuple[Rock, ...] = ()
    kind: str = "hills"
    holes: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Attitude:
    """The pose and tilt of the body. Positive pitch is nose down, positive roll left side up."""

    pose: Pose
    roll: float = 0.0
    pitch: float = 0.0


@dataclass(frozen=True, slots=True)
class Posture:
    """The body's attitude, and (angle, reach, drop) of each leg. Angles may exceed a turn."""

    attitude: Attitude
    joints: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class Readings:
    """The present values of the robot's own sensors.

    They are two inclinometers, six foot force sensors (NaN: broken) and each leg's amplifier (on or
    off). *encoder_offsets* (m) compare the relative and the absolute encoder of each leg's reach.
    """

    time: float
    roll: float
    pitch: float
    loads: tuple[float, ...]
    amplifiers: tuple[bool, ...] = (True,) * 6
    encoder_offsets: tuple[float, ...] = (0.0,) * 6


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault: one of KINDS, its leg, its size (by kind), and whether only an operator can reset
    it.
    """

    kind: str
    leg: int = NO_LEG
    size: float = 0.0
    needs_operator: bool = False


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A felt obstacle: legs should not pass it (*is_wall*), or not stand on it."""

    x: float
    y: float
    z: float
    radius: float
    is_wall: bool


@dataclass(frozen=True, slots=True)
class Window:
    """A square of ground: its middle, and how far (m) it reaches on each side."""

    x: float
    y: float
    reach: float


@dataclass(frozen=True, slots=True)
class Image:
    """A range image. Its *number* is greater than all earlier ones, even after a restart."""

    number: int
    scan: Scan


@dataclass(frozen=True, slots=True)
class Footstep:
    """One line of the walk's record, made after each body move: the robot's belief and the truth.

    *slope* is that of the ground under the body, rise per run. *tilt* (rad) is the greatest since
    the last footstep. *margin* (m) is the distance of the centre of gravity from the edge of the
    support.
    """

    number: int
    leg: int
    foot: Foot
    true_foot: Foot
    pose: Pose
    true_pose: Pose
    slope: float
    tilt: float
    margin: float


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state with which a new process continues the walk. *pose* is the robot's believed pose,
    *trail* its last footholds, oldest first. *faults* are present, *armed* ones are about to begin.
    """

    backend: str
    terrain: TerrainSpec
    time: float
    posture: Posture
    pose: Pose
    last_leg: int
    scans: int
    footsteps: int
    trail: tuple[Foot, ...]
    faults: tuple[Fault, ...] = ()
    armed: tuple[Fault, ...] = ()
