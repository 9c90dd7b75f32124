"""The world of the turtles: a square sheet, turtles that move on arcs, and the lines of their pens.

It is deterministic: the same commands at the same times draw the same lines. It has no clock: time
passes only in ``advance``.
"""

import math
from dataclasses import dataclass, field, replace

from robots.turtle_sim.errors import NoSuchTurtle, TurtleExists

SIZE = 11.0
"""The length of each side. The origin is at the lower left; angles count from the x axis leftwards.
"""

STEP = 1 / 64
"""Seconds between two points of a line."""

COMMAND_LIFE = 1.0
"""Seconds after which a turtle without a new command stops, as in turtlesim."""

FASTEST = 50.0
"""The greatest speed of a command, in units or radians a second. Faster commands are limited to
it.
"""

STRAIGHT = 1e-9
"""Radians a second below which a turtle moves straight ahead."""


@dataclass(frozen=True, slots=True)
class Pose:
    """The place and heading of a turtle, and how fast it moves and turns."""

    x: float
    y: float
    theta: float = 0.0
    linear_velocity: float = 0.0
    angular_velocity: float = 0.0


CENTRE = Pose(SIZE / 2, SIZE / 2)


@dataclass(frozen=True, slots=True)
class Pen:
    """A turtle's pen. It draws while it is down."""

    red: int = 0
    green: int = 0
    blue: int = 0
    width: int = 2
    is_down: bool = True

    @property
    def colour(self) -> str:
        """The colour as ``#rrggbb``."""
        return f"#{self.red:02x}{self.green:02x}{self.blue:02x}"


@dataclass(slots=True)
class Stroke:
    """A line of one pen."""

    pen: Pen
    points: list[tuple[float, float]]


@dataclass(slots=True)
class Turtle:
    """One turtle.

    *command_left* is the number of seconds for which the turtle still follows its last command.
    *unstepped* is the time since its last whole step.
    """

    pose: Pose
    pen: Pen = field(default_factory=Pen)
    command_left: float = 0.0
    time: float = 0.0
    unstepped: float = 0.0
    stroke: Stroke | None = None


class TurtleWorld:
    """All turtles and their lines."""

    def __init__(self) -> None:
        self.turtles: dict[str, Turtle] = {}
        self.strokes: list[Stroke] = []

    # --- actions ----------------------------------------------------------------------------------

    def spawn(self, name: str, pose: Pose = CENTRE) -> None:
        """Add a turtle, with its pen down."""
        if name in self.turtles:
            raise TurtleExists(f"there is already a turtle '{name}': give another name")
        self.turtles[name] = Turtle(
            _on_the_sheet(replace(pose, linear_velocity=0.0, angular_velocity=0.0))
        )

    def command(self, name: str, linear: float, angular: float) -> None:
        """Move (units a second) and turn (radians a second), for at most ``COMMAND_LIFE``."""
        turtle = self.turtle(name)
        turtle.pose = replace(
            turtle.pose, linear_velocity=_limited(linear), angular_velocity=_limited(angular)
        )
        turtle.command_left = COMMAND_LIFE

    def set_pen(self, name: str, pen: Pen) -> None:
        """Change the pen, and start a new stroke."""
        turtle = self.turtle(name)
        turtle.pen, turtle.stroke = pen, None

    def clear(self) -> None:
        """Wipe the sheet; turtles stay where they are."""
        self.strokes.clear()
        for turtle in self.turtles.values():
            turtle.stroke = None

    def turtle(self, name: str) -> Turtle:
        """Return the turtle of this name."""
        if name not in self.turtles:
            raise NoSuchTurtle(
                f"there is no turtle '{name}': the turtles are {', '.join(self.turtles) or 'none'}"
            )
        return self.turtles[name]

    # --- time -------------------------------------------------------------------------------------

    def advance(self, seconds: float, *names: str) -> None:
        """Let time pass for the turtles of these names, or for all, in whole steps.

        The rest of a step counts at the next call. Turtles don't touch each other, so each may have
        a separate time.
        """
        for turtle in map(self.turtle, names or self.turtles):
            turtle.unstepped += seconds
            for _ in range(int(turtle.unstepped / STEP + 1e-9)):
                turtle.unstepped -= STEP
                turtle.time += STEP
                self._step(turtle)

    def _step(self, turtle: Turtle) -> None:
        if turtle.command_left <= 0.0:
            return
        before = turtle.pose
        turtle.pose = _on_the_sheet(moved(before, STEP))
        self._draw(turtle, before)
        turtle.command_left -= STEP
        if turtle.command_left <= 0.0:
            turtle.pose = replace(turtle.pose, linear_velocity=0.0, angular_velocity=0.0)

    def _draw(self, turtle: Turtle, before: Pose) -> None:
        pose = turtle.pose
        if not turtle.pen.is_down or (pose.x, pose.y) == (before.x, before.y):
            return
        if turtle.stroke is None:
            turtle.stroke = Stroke(turtle.pen, [(before.x, before.y)])
            self.strokes.append(turtle.stroke)
        points = turtle.stroke.points
        if len(points) > 1 and _is_between(points[-2], points[-1], (pose.x, pose.y)):
            points.pop()
        points.append((pose.x, pose.y))


def moved(pose: Pose, seconds: float) -> Pose:
    """Return the pose after some time on its arc, as if there were no walls."""
    speed, turn = pose.linear_velocity, pose.angular_velocity * seconds
    theta = math.remainder(pose.theta + turn, math.tau)
    if abs(pose.angular_velocity) < STRAIGHT:
        ahead = speed * seconds
        return replace(
            pose,
            x=pose.x + ahead * math.cos(theta),
            y=pose.y + ahead * math.sin(theta),
            theta=theta,
        )
    radius = speed / pose.angular_velocity
    end = pose.theta + turn
    x = pose.x + radius * (math.sin(end) - math.sin(pose.theta))
    y = pose.y - radius * (math.cos(end) - math.cos(pose.theta))
    return replace(pose, x=x, y=y, theta=theta)


def _limited(speed: float) -> float:
    """Limit a commanded speed; NaN is 0."""
    return 0.0 if math.isnan(speed) else min(max(speed, -FASTEST), FASTEST)


def _on_the_sheet(pose: Pose) -> Pose:
    return replace(pose, x=min(max(pose.x, 0.0), SIZE), y=min(max(pose.y, 0.0), SIZE))


def _is_between(
    start: tuple[float, float], middle: tuple[float, float], end: tuple[float, float]
) -> bool:
    """Return whether *middle* is on the straight line between the others, to a millionth."""
    (ax, ay), (bx, by), (cx, cy) = start, middle, end
    along = (bx - ax) * (cx - bx) + (by - ay) * (cy - by)
    area = abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    return along > 0.0 and area < 1e-6 * math.hypot(cx - ax, cy - ay)
