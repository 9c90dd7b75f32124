"""A drawing of the robot and its places from above, and of the arm from the side, as SVG text."""

from collections.abc import Iterable

from robots.drawing import View
from robots.plane import world_place
from robots.youbot_sim.kinematics import MOUNT, chain, tip_in_world
from robots.youbot_sim.places import BOX_B, BOXES, POSES
from robots.youbot_sim.vocabulary import JointReadings, Joints, ObjectPlace
from tca_tools.drawing.svg import document

WIDTH, HEIGHT = 960, 470
MAP, SIDE = View(80.0, 180.0, 115.0), View(700.0, 420.0, 330.0)
LENGTH, BREADTH, DECK = 0.58, 0.376, 0.13
OBJECT = 0.06
STYLE = (
    "text{font:13px sans-serif;fill:#444}"
    ".ink{stroke:#33363d;fill:none;stroke-linecap:round;stroke-linejoin:round}"
    ".base{fill:#e8792b;stroke:#33363d;stroke-width:1.5}.dark{fill:#33363d}"
    ".lid{fill:#8a95a3;stroke:#41566e}.box{fill:#c9d6e6;stroke:#41566e;stroke-width:2}"
    ".object{fill:#2c9a57;stroke:#1b5f36}"
    ".place{fill:none;stroke:#aaa;stroke-dasharray:4 3}"
)


def draw(robot: JointReadings, *, is_covered: bool) -> str:
    """Draw the robot. *is_covered*: box B has its lid on."""
    parts = [*_map(robot, is_covered=is_covered), *_side(robot)]
    return document(WIDTH, HEIGHT, "the youBot, from above and from the side", STYLE, parts)


def _map(robot: JointReadings, *, is_covered: bool) -> Iterable[str]:
    """Yield the parts of the view from above: the places, the boxes, the robot with its arm."""
    yield '<text x="20" y="24">from above</text>'
    for name, place in POSES["base"].items():
        yield _block("place", place, LENGTH, BREADTH)
        yield MAP.words(name, place, right=-4, down=5)
    for box in BOXES:
        look = "lid" if is_covered and box is BOX_B else "box"
        place = box.x, box.y, box.heading
        yield _block(look, place, box.side, box.side)
        if box.place is robot.object:
            yield _block("object", place, OBJECT, OBJECT)
    x, y, heading = robot.base
    tip = tip_in_world(robot.base, robot.arm)
    yield _block("base", robot.base, LENGTH, BREADTH)
    yield MAP.line("ink", [world_place(x, y, heading, MOUNT, 0.0), tip], stroke_width=7)
    if robot.object in (ObjectPlace.HELD, ObjectPlace.OFFERED):
        yield _block("object", (tip[0], tip[1], heading + robot.arm[0]), OBJECT, OBJECT)


def _block(look: str, place: Joints, length: float, breadth: float) -> str:
    """Return a rectangle around a place of the map, by x, y and heading."""
    x, y, heading = place
    corners = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return MAP.shape(
        look, (world_place(x, y, heading, a * length / 2, b * breadth / 2) for a, b in corners)
    )


def _side(robot: JointReadings) -> Iterable[str]:
    """Yield the parts of the view from the side, in the plane in which the arm leans."""
    joints = [(MOUNT, DECK), *((MOUNT + ahead, up) for ahead, up in chain(robot.arm))]
    yield SIDE.words(f"the arm, object: {robot.object}", (0.0, 0.0), right=-110, down=-396)
    yield SIDE.line("ink", [(-1 / 3, 0.0), (240 / SIDE.scale, 0.0)])
    yield SIDE.box("base", (-LENGTH / 2, 0.05), LENGTH, DECK - 0.05)
    yield from (SIDE.disc("dark", (ahead, 0.05), 0.05) for ahead in (-0.235, 0.235))
    yield SIDE.line("ink", joints, stroke_width=10)
    if robot.object is ObjectPlace.HELD:
        ahead, up = joints[-1]
        half = 8 / SIDE.scale
        yield SIDE.box("object", (ahead - half, up - half), 2 * half, 2 * half)
