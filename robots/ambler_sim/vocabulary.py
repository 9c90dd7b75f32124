"""The nouns of a walking Ambler: plain frozen data that can be sent as messages and saved as JSON.

World frame: x forward at the start, y left, z up. Metres, radians, seconds, newtons throughout.
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
"""Of faults: of the machine, of the scanner, of the ground, of planners, of programs."""

TERRAINS = ("flat", "rolling", "hills", "boulders", "ditches", "soft")


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the (level) body is: the point between the shafts at the lowest shoulder level."""

    x: float
    y: float
    heading: float
    height: float


ORIGIN = Pose(0.0, 0.0, 0.0, 0.0)
"""Where walks begin; the height comes from the ground."""


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
    """A path for the body: *length* metres from *start*, turning left where *curvature* (1/m) is
    positive.
    """

    start: Pose
    curvature: float
    length: float


@dataclass(frozen=True, slots=True)
class Step:
    """One footstep: *leg* goes to about *ideal*, then the body to *goal*.

    *support* are the body poses during which the new foothold has to stay in reach, from now until
    it is lifted. *remaining* metres of the arc are left after the step. The height of *goal* is not
    yet known (see gait.py).
    """

    leg: int
    ideal: Foot
    goal: Pose
    before: Stance
    support: tuple[Pose, ...]
    remaining: float


@dataclass(frozen=True, slots=True)
class LegMove:
    """Lift the foot to world height *lift*, retract to *radius*, rotate, extend over *foothold*,
    lower until it stands.

    *sense* +1 rotates counter-clockwise seen from above, -1 clockwise, 0 the short way.
    """

    leg: int
    foothold: Foot
    lift: float
    radius: float
    sense: int


@dataclass(frozen=True, slots=True)
class BodyMove:
    """Bring the body to *goal* in *duration* seconds while all feet stay where they are."""

    goal: Pose
    duration: float


@dataclass(frozen=True, slots=True)
class Footfall:
    """How a leg move ended. *load* is the vertical force on the foot; *reached* is false when the
    move was stopped.
    """

    foot: Foot
    load: float
    reached: bool


@dataclass(frozen=True, slots=True)
class Contact:
    """A leg on its way met something: where its foot was, with what force (N) it was stopped, and
    which way it went (a unit vector; none if it went down). Or the body (leg -1): the place is that
    of its front.
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

    *x*, *y* is the centre of the first cell. *heights* are rows*columns float32, NaN where nothing
    is known nearby; *known* has one byte per cell: 1 measured, 0 filled in. Read them with
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
    """A range image turned into world points (n*3 float32), and the stance in which it was
    taken.
    """

    stance: Stance
    points: bytes


@dataclass(frozen=True, slots=True)
class Rock:
    """An upright round stone through which the scanner looks; *height* is that of its top over the
    ground around it.
    """

    x: float
    y: float
    radius: float
    height: float


@dataclass(frozen=True, slots=True)
class TerrainSpec:
    """All that is needed to make the same ground again: its kind (one of TERRAINS), its steepest
    gradient (rise per run), rocks, and the places (x, y) where it gave way.
    """

    seed: int = 1
    slope: float = 0.10
    rocks: tuple[Rock, ...] = ()
    kind: str = "hills"
    holes: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Attitude:
    """Where the body is and how it is tilted; pitch is positive nose down, roll positive left side
    up.
    """

    pose: Pose
    roll: float = 0.0
    pitch: float = 0.0


@dataclass(frozen=True, slots=True)
class Posture:
    """The body's attitude, and (angle, reach, drop) of each leg; angles count whole turns."""

    attitude: Attitude
    joints: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class Readings:
    """The values of the robot's own sensors now: two inclinometers, six foot force sensors (NaN:
    broken), which legs' amplifiers are on, and how far (m) each leg's relative encoder of the reach
    is off its absolute one.
    """

    time: float
    roll: float
    pitch: float
    loads: tuple[float, ...]
    amplifiers: tuple[bool, ...] = (True,) * 6
    encoder_offsets: tuple[float, ...] = (0.0,) * 6


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong: what (one of KINDS), with which leg, how much of it (its kind says
    of what), and whether only an operator can reset it.
    """

    kind: str
    leg: int = NO_LEG
    size: float = 0.0
    needs_operator: bool = False


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A place that was felt: legs should not pass it (*is_wall*), or not stand on it."""

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
    """A range image; its *number* is greater than those of all images before, also where a program
    has died between.
    """

    number: int
    scan: Scan


@dataclass(frozen=True, slots=True)
class Footstep:
    """One line of the scorer's record, made after each body move: what the robot believes, and what
    is true.

    *slope* is that of the ground under the body, rise per run; *tilt* (rad) the greatest since the
    last footstep; *margin* (m) the distance of the centre of gravity from the support's edge.
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
    """Everything a new process needs to go on with the walk. *pose* is where the robot believes to
    be, *trail* the last footholds, oldest first. *faults* are what is wrong, *armed* what is about
    to go wrong.
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
