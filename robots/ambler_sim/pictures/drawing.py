"""A drawing of the robot from the side and from above, as SVG; it needs no physics engine."""

from collections.abc import Iterable, Sequence

import numpy as np

from robots.ambler_sim.geometry import (
    AMBLER,
    BODY_HEIGHT,
    SHAFT_Y,
    SHOULDER_Z,
    is_left,
    offset,
    seen_by,
)
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.planning.stability import support_polygon, world_centre_of_gravity
from robots.ambler_sim.vocabulary import Foot, Pose, Stance
from robots.drawing import View
from robots.plane import seen_from, world_place
from tca_tools.drawing.svg import document

WIDTH, HEIGHT = 960, 430
SCALE = 52.0
BEHIND, AHEAD = 4.2, 4.2
SIDE_FLOOR, TOP_MIDDLE = 60.0, 215.0
HALF = (BEHIND + AHEAD) * SCALE
"""The width in pixels of each of the two views."""

SIDE = View(20.0 + BEHIND * SCALE, HEIGHT - SIDE_FLOOR, SCALE)
ABOVE = View(WIDTH - HALF - 20.0 + BEHIND * SCALE, TOP_MIDDLE, SCALE)
"""Positions are relative to the body: how far ahead, and how far up or left."""

STRATUM = 0.1
CELL = 0.125
SOIL, LOW_SOIL, HIGH_SOIL = "#dcc29e", (196, 164, 122), (242, 230, 208)
LEFT_COLOUR, RIGHT_COLOUR = "#2a5ca8", "#d9701a"
STYLE = (
    "text{font:13px sans-serif;fill:#444}.ink{stroke:#33363d;fill:none;stroke-linecap:round}"
    ".box{fill:#ede6d2;stroke:#33363d;stroke-width:1.5}.dark{fill:#33363d}"
    ".rock{fill:#8c8781;stroke:#5d5954}.print{fill:#8d7656;opacity:.45}"
)


def draw(stance: Stance, terrain: Terrain, trail: Sequence[Foot]) -> str:
    """Draw the robot. Both views are along the robot's own axes, whatever its heading."""
    side_title = f"from the right, x = {stance.pose.x:.1f} m"
    top_title = "from above: support polygon, centre of gravity, footprints"
    body = [
        *_panel("side", SIDE, side_title, _from_the_side(stance, terrain)),
        *_panel("above", ABOVE, top_title, _from_above(stance, terrain, trail)),
    ]
    return document(WIDTH, HEIGHT, "the Ambler, from the side and from above", STYLE, body)


def _panel(name: str, view: View, title: str, parts: Iterable[str]) -> Iterable[str]:
    """Yield one half of the picture: the parts of a view, clipped, and its title."""
    left = view.left - BEHIND * SCALE
    clip = f'<rect x="{left:.1f}" y="30" width="{HALF:.1f}" height="{HEIGHT - 50}" rx="8"/>'
    yield f'<clipPath id="{name}">{clip}</clipPath><g clip-path="url(#{name})">'
    yield from parts
    yield "</g>"
    yield f'<text x="{left + 6:.1f}" y="22">{title}</text>'


def _from_the_side(stance: Stance, terrain: Terrain) -> Iterable[str]:
    """Yield the parts of the view from the right: ground, far (left) legs, body, near legs."""
    pose = stance.pose
    floor = pose.height - BODY_HEIGHT
    ahead = np.arange(-BEHIND, AHEAD + 0.2, 0.2)
    x, y = np.array([offset(pose, float(distance), 0.0) for distance in ahead]).T
    ground = [
        *zip(ahead, terrain.heights_at(x, y) - floor, strict=True),
        (AHEAD, -5.0),
        (-BEHIND, -5.0),
    ]
    legs = [
        _leg_from_the_side(foot.leg, seen_by(pose, foot)[0], foot.z - floor) for foot in stance.feet
    ]
    yield '<rect y="30" width="100%" height="100%" fill="#eef3f8"/>'
    for rock in terrain.rocks:
        bottom, top = terrain.height(rock.x, rock.y) - 0.5, terrain.top(rock)
        corner = seen_by(pose, rock)[0] - rock.radius, bottom - floor
        yield SIDE.box("rock", corner, 2 * rock.radius, top - bottom)
    yield SIDE.shape("soil", ground, fill=SOIL, stroke="#8d7656")
    yield from legs[:3]
    yield from _body_from_the_side(BODY_HEIGHT)
    yield from legs[3:]


def _body_from_the_side(low: float) -> Iterable[str]:
    """Shaft, deck, equipment box, scanner on its mast. *low*: height of the lowest shoulder."""
    yield SIDE.box("dark", (-0.17, low - 0.4), 0.34, 1.7)
    yield SIDE.box("dark", (-0.48, low + 1.28), 0.95, 0.24)
    yield SIDE.box("box", (-0.47, low + 1.52), 0.70, 0.70)
    yield _line(SIDE, [(0.3, low + 1.4), (0.75, low + 1.4), (0.75, low + 2.4)], 4)
    yield SIDE.box("box", (0.60, low + 2.35), 0.40, 0.30)


def _leg_from_the_side(leg: int, ahead: float, ground: float) -> str:
    colour, level = _colour(leg), BODY_HEIGHT + float(SHOULDER_Z[leg])
    beam = _line(SIDE, [(0.0, level), (ahead, level)], 6, colour)
    link = _line(SIDE, [(ahead, ground + 0.1), (ahead, ground + AMBLER.link_length)], 4, colour)
    return beam + link + SIDE.box("dark", (ahead - 0.22, ground), 0.44, 0.12)


def _from_above(stance: Stance, terrain: Terrain, trail: Sequence[Foot]) -> Iterable[str]:
    """Height bands, footprints, support polygon, legs, stacks and the centre of gravity."""
    pose = stance.pose
    corners = [seen_from(pose.x, pose.y, pose.heading, x, y) for x, y, _ in support_polygon(stance)]
    x, y, _ = world_centre_of_gravity(stance)
    yield from _height_bands(pose, terrain)
    yield from (ABOVE.disc("rock", seen_by(pose, rock), rock.radius) for rock in terrain.rocks)
    yield from (ABOVE.disc("print", seen_by(pose, foot), 0.2) for foot in trail)
    yield ABOVE.shape("support", corners, fill="#3a7d44", fill_opacity=".16", stroke="#3a7d44")
    yield ABOVE.box("box", (-0.35, -1.3), 0.7, 2.6)
    for foot in stance.feet:
        there = seen_by(pose, foot)
        yield _line(ABOVE, [(0.0, float(SHAFT_Y[foot.leg])), there], 6, _colour(foot.leg))
        yield ABOVE.disc("dark", there, 0.22)
        yield ABOVE.words(f"{foot.leg}", (there[0], there[1] + 0.3), text_anchor="middle")
    yield from (ABOVE.disc("dark", (0.0, float(y)), 0.2) for y in SHAFT_Y[[0, 3]])
    yield _line(ABOVE, [(0.45, -0.25), (0.75, 0.0), (0.45, 0.25)], 3)
    centre = seen_from(pose.x, pose.y, pose.heading, x, y)
    yield ABOVE.disc("centre", centre, 5 / SCALE, fill="#fff", stroke="#3a7d44", stroke_width=3)


def _height_bands(pose: Pose, terrain: Terrain) -> list[str]:
    """Strips of ground of one stratum each, row by row across the way; higher is lighter."""
    rows = np.arange(-BEHIND, AHEAD, CELL)
    columns = np.arange(-TOP_MIDDLE / SCALE, TOP_MIDDLE / SCALE, CELL)
    ahead, left = np.meshgrid(rows + CELL / 2, columns + CELL / 2, indexing="ij")
    heights = terrain.heights_at(*world_place(pose.x, pose.y, pose.heading, ahead, left))
    strata = np.floor((heights - heights.min()) / STRATUM).astype(int)
    strips: dict[str, list[str]] = {}
    for row, levels in zip(rows, strata, strict=True):
        starts = np.flatnonzero(np.diff(levels, prepend=-1))
        for start, end in zip(starts, [*starts[1:], len(levels)], strict=True):
            colour = _soil_colour(levels[start] / max(strata.max(), 1))
            strips.setdefault(colour, []).append(_strip(row, columns[start], CELL * (end - start)))
    return [f'<path fill="{colour}" d="{"".join(each)}"/>' for colour, each in strips.items()]


def _soil_colour(share: float) -> str:
    red, green, blue = (
        round(low + share * (high - low)) for low, high in zip(LOW_SOIL, HIGH_SOIL, strict=True)
    )
    return f"#{red:02x}{green:02x}{blue:02x}"


def _strip(ahead: float, left: float, breadth: float) -> str:
    """Return a rectangle as a piece of a path, a little too large so that no seam shows."""
    x, y = ABOVE.at(ahead, left + breadth)
    width, height = CELL * SCALE + 0.6, breadth * SCALE + 0.6
    return f"M{x:.1f} {y:.1f}h{width:.1f}v{height:.1f}h{-width:.1f}z"


def _colour(leg: int) -> str:
    return LEFT_COLOUR if is_left(leg) else RIGHT_COLOUR


def _line(
    view: View, places: Iterable[Sequence[float]], width: int, colour: str = "#33363d"
) -> str:
    return view.line("ink", places, style=f"stroke:{colour};stroke-width:{width}")
