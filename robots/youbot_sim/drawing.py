"""A drawing of the robot from above, with places and boxes, and of its arm from the side, as SVG text."""

import math
from collections.abc import Iterable

from robots.youbot_sim.kinematics import FORE, HAND, MOUNT, SHOULDER_AHEAD, SHOULDER_HEIGHT, UPPER, tip_in_world
from robots.youbot_sim.places import BOXES, POSES
from robots.youbot_sim.vocabulary import JointReadings, Joints, ObjectPlace

WIDTH, HEIGHT = 960, 470
MAP_SCALE, MAP_LEFT, MAP_MIDDLE = 115.0, 80.0, 180.0
SIDE_SCALE, SIDE_LEFT, SIDE_FLOOR = 330.0, 700.0, 420.0
LENGTH, BREADTH, DECK = 0.58, 0.376, 0.13
STYLE = (
    "text{font:13px sans-serif;fill:#444}.ink{stroke:#33363d;fill:none;stroke-linecap:round;stroke-linejoin:round}"
    ".base{fill:#e8792b;stroke:#33363d;stroke-width:1.5}.dark{fill:#33363d}.lid{fill:#8a95a3;stroke:#41566e}"
    ".box{fill:#c9d6e6;stroke:#41566e;stroke-width:2}.object{fill:#2c9a57;stroke:#1b5f36}"
    ".place{fill:none;stroke:#aaa;stroke-dasharray:4 3}"
)
Corner = tuple[float, float]


def draw(robot: JointReadings, *, is_covered: bool) -> str:
    """The picture. *is_covered*: box B has its lid on."""
    parts = [*_map(robot, is_covered=is_covered), *_side(robot)]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">'
        f'<style>{STYLE}</style><rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>\n'
        + "\n".join(parts)
        + "\n</svg>\n"
    )


def _map(robot: JointReadings, *, is_covered: bool) -> list[str]:
    """From above: the places, the boxes, the robot with its arm."""
    parts = ['<text x="20" y="24">from above</text>']
    for name, (x, y, heading) in POSES["base"].items():
        left, down = _on_map(x, y)
        parts += [
            _shape("place", _rectangle(x, y, heading, LENGTH, BREADTH)),
            f'<text x="{left - 4:.1f}" y="{down + 5:.1f}">{name}</text>',
        ]
    for box in BOXES:
        is_closed = is_covered and box.place is ObjectPlace.BOX_B
        side = box.size + 2 * box.wall
        parts.append(_shape("lid" if is_closed else "box", _rectangle(box.x, box.y, box.heading, side, side)))
        if box.place is robot.object:
            parts.append(_shape("object", _rectangle(box.x, box.y, box.heading, 0.06, 0.06)))
    x, y, heading = robot.base
    tip = tip_in_world(robot.base, robot.arm)
    mount = (x + MOUNT * math.cos(heading), y + MOUNT * math.sin(heading))
    parts += [
        _shape("base", _rectangle(x, y, heading, LENGTH, BREADTH)),
        f'<polyline class="ink" stroke-width="7" points="{_points(_on_map(*at) for at in (mount, tip[:2]))}"/>',
    ]
    if robot.object in (ObjectPlace.HELD, ObjectPlace.OFFERED):
        parts.append(_shape("object", _rectangle(tip[0], tip[1], heading + robot.arm[0], 0.06, 0.06)))
    return parts


def _side(robot: JointReadings) -> list[str]:
    """The arm from the side, in the plane in which it leans."""
    joints = [_at_side(MOUNT, DECK), *(_at_side(ahead, up) for ahead, up in _chain(robot.arm))]
    deck = [_at_side(-LENGTH / 2, DECK), _at_side(LENGTH / 2, 0.05)]
    wheels = "".join(
        f'<circle class="dark" cx="{x:.1f}" cy="{y:.1f}" r="{0.05 * SIDE_SCALE:.1f}"/>'
        for x, y in (_at_side(-0.235, 0.05), _at_side(0.235, 0.05))
    )
    (left, top), (right, bottom) = deck
    size = f'width="{right - left:.1f}" height="{bottom - top:.1f}"'
    body = f'<rect class="base" x="{left:.1f}" y="{top:.1f}" {size}/>'
    tip = joints[-1]
    held = f'<rect class="object" x="{tip[0] - 8:.1f}" y="{tip[1] - 8:.1f}" width="16" height="16"/>'
    return [
        f'<text x="{SIDE_LEFT - 110:.0f}" y="24">the arm, object: {robot.object}</text>',
        f'<line class="ink" x1="{SIDE_LEFT - 110}" y1="{SIDE_FLOOR}" x2="{WIDTH - 20}" y2="{SIDE_FLOOR}"/>',
        f"{body}{wheels}",
        f'<polyline class="ink" stroke-width="10" points="{_points(joints)}"/>',
        held if robot.object is ObjectPlace.HELD else "",
    ]


def _chain(arm: Joints) -> Iterable[Corner]:
    """Shoulder, elbow, wrist and fingertips: how far ahead and up."""
    ahead, up, lean = MOUNT + SHOULDER_AHEAD, SHOULDER_HEIGHT, 0.0
    yield ahead, up
    for length, angle in zip((UPPER, FORE, HAND), arm[1:4], strict=True):
        lean += angle
        ahead, up = ahead + length * math.sin(lean), up + length * math.cos(lean)
        yield ahead, up


def _rectangle(x: float, y: float, heading: float, length: float, breadth: float) -> list[Corner]:
    cos, sin = math.cos(heading), math.sin(heading)
    corners = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    sides = [(a * length / 2, b * breadth / 2) for a, b in corners]
    return [_on_map(x + cos * a - sin * b, y + sin * a + cos * b) for a, b in sides]


def _shape(kind: str, corners: Iterable[Corner]) -> str:
    return f'<polygon class="{kind}" points="{_points(corners)}"/>'


def _points(corners: Iterable[Corner]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)


def _on_map(x: float, y: float) -> Corner:
    return MAP_LEFT + x * MAP_SCALE, MAP_MIDDLE - y * MAP_SCALE


def _at_side(ahead: float, up: float) -> Corner:
    return SIDE_LEFT + ahead * SIDE_SCALE, SIDE_FLOOR - up * SIDE_SCALE
