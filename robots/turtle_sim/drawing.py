"""The sheet as an SVG picture: a faint grid, the strokes, and the turtles on top."""

from collections.abc import Iterable

from robots.drawing import View
from robots.plane import world_place
from robots.turtle_sim.messages import SeenTurtle, Sheet
from robots.turtle_sim.world import SIZE
from tca_tools.drawing.svg import document

SCALE = 50.0
"""Pixels per unit."""

MARGIN, TOP = 30.0, 36.0
BODY = ((0.32, 0.0), (-0.2, 0.2), (-0.1, 0.0), (-0.2, -0.2))
"""The corners of a turtle that heads along the x axis."""

STYLE = (
    ".line { stroke: #e4e8ec; } .sheet { fill: #fff; stroke: #9aa5b1; }"
    " .stroke { fill: none; stroke-linejoin: round; stroke-linecap: round; }"
    " .turtle { stroke: #fff; stroke-width: 1.5; } .name { font-weight: bold; }"
)
VIEW = View(MARGIN, TOP + SIZE * SCALE, SCALE)


def draw(sheet: Sheet, title: str) -> str:
    """Draw the sheet."""
    body = [
        VIEW.words(title, (0.0, SIZE), down=-12, class_="title"),
        VIEW.box("sheet", (0.0, 0.0), SIZE, SIZE),
        *_grid(),
        *(
            VIEW.line(
                "stroke", stroke.points, stroke=stroke.pen.colour, stroke_width=stroke.pen.width
            )
            for stroke in sheet.strokes
        ),
        *(part for name, turtle in sheet.turtles.items() for part in _turtle(name, turtle)),
    ]
    side = SIZE * SCALE
    return document(side + 2 * MARGIN, side + TOP + MARGIN, title, STYLE, body)


def _grid() -> Iterable[str]:
    """Yield a line for each unit, with its number below and at the left."""
    for number in range(int(SIZE) + 1):
        if 0 < number < SIZE:
            yield VIEW.line("line", [(number, 0), (number, SIZE)])
            yield VIEW.line("line", [(0, number), (SIZE, number)])
        yield VIEW.words(f"{number}", (number, 0), down=16, text_anchor="middle")
        yield VIEW.words(f"{number}", (0, number), right=-6, down=4, text_anchor="end")


def _turtle(name: str, turtle: SeenTurtle) -> Iterable[str]:
    x, y, heading = turtle.pose.x, turtle.pose.y, turtle.pose.theta
    yield VIEW.shape(
        "turtle", (world_place(x, y, heading, *corner) for corner in BODY), fill=turtle.pen.colour
    )
    has_room = (SIZE - y) * SCALE > 30
    yield VIEW.words(
        name, (x, y), down=-18 if has_room else 28, class_="name", text_anchor="middle"
    )
