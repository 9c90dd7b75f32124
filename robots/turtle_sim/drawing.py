"""The sheet as an SVG picture: a faint grid, the strokes, and the turtles on top."""

import math
from collections.abc import Iterable, Sequence

from robots.turtle_sim.messages import SeenTurtle, Sheet
from robots.turtle_sim.world import SIZE, Stroke
from tca_tools.drawing.svg import document, text

SCALE = 50.0
"""Pixels a unit."""

MARGIN, TOP = 30.0, 36.0
BODY = ((0.32, 0.0), (-0.2, 0.2), (-0.1, 0.0), (-0.2, -0.2))
"""A turtle that looks along the x axis."""

STYLE = (
    ".line { stroke: #e4e8ec; } .sheet { fill: #fff; stroke: #9aa5b1; } .stroke { fill: none; stroke-linejoin: round;"
    " stroke-linecap: round; } .turtle { stroke: #fff; stroke-width: 1.5; } .name { font-weight: bold; }"
)


def draw(sheet: Sheet, title: str) -> str:
    """The picture, as text."""
    side = SIZE * SCALE
    left, top = _at(0.0, SIZE)
    body = [
        f'<text class="title" x="{left:.0f}" y="{top - 12:.0f}">{text(title)}</text>',
        f'<rect class="sheet" x="{left:.0f}" y="{top:.0f}" width="{side:.0f}" height="{side:.0f}"/>',
        *_grid(),
        *map(_line, sheet.strokes),
        *(_turtle(name, turtle) for name, turtle in sheet.turtles.items()),
    ]
    return document(side + 2 * MARGIN, side + TOP + MARGIN, title, STYLE, body)


def _at(x: float, y: float) -> tuple[float, float]:
    """Picture coordinates; the y axis of the sheet goes up."""
    return MARGIN + x * SCALE, TOP + (SIZE - y) * SCALE


def _points(places: Iterable[Sequence[float]]) -> str:
    return " ".join("{:.1f},{:.1f}".format(*_at(place[0], place[1])) for place in places)


def _grid() -> Iterable[str]:
    """A line for each unit, with its number below and at the left."""
    for number in range(int(SIZE) + 1):
        if 0 < number < SIZE:
            yield f'<polyline class="line" points="{_points([(number, 0), (number, SIZE)])}"/>'
            yield f'<polyline class="line" points="{_points([(0, number), (SIZE, number)])}"/>'
        (x, floor), (left, y) = _at(number, 0), _at(0, number)
        yield f'<text x="{x:.1f}" y="{floor + 16:.1f}" text-anchor="middle">{number}</text>'
        yield f'<text x="{left - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{number}</text>'


def _line(stroke: Stroke) -> str:
    look = f'stroke="{stroke.pen.colour}" stroke-width="{stroke.pen.width}"'
    return f'<polyline class="stroke" {look} points="{_points(stroke.points)}"/>'


def _turtle(name: str, turtle: SeenTurtle) -> str:
    pose = turtle.pose
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    body = [(pose.x + cos * ahead - sin * left, pose.y + sin * ahead + cos * left) for ahead, left in BODY]
    x, y = _at(pose.x, pose.y)
    above = y - 18 if y > TOP + 30 else y + 28
    label = f'<text class="name" x="{x:.1f}" y="{above:.1f}" text-anchor="middle">{text(name)}</text>'
    return f'<polygon class="turtle" fill="{turtle.pen.colour}" points="{_points(body)}"/>{label}'
