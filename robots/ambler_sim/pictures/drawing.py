"""A drawing of the robot from the side and from above, as SVG text. For where there is no physics engine to render."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from robots.ambler_sim.geometry import AMBLER, BODY_HEIGHT, SHAFT_Y, SHOULDER_Z, Array, offset
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.planning.stability import support_polygon, world_centre_of_gravity
from robots.ambler_sim.vocabulary import Foot, Pose, Stance

WIDTH, HEIGHT = 960, 430
SCALE = 52.0
BEHIND, AHEAD = 4.2, 4.2
SIDE_FLOOR, TOP_MIDDLE = 60.0, 215.0
STRATUM = 0.1
SOIL, LOW_SOIL, HIGH_SOIL = "#dcc29e", (196, 164, 122), (242, 230, 208)
LEFT_COLOUR, RIGHT_COLOUR = "#2a5ca8", "#d9701a"
STYLE = (
    "text{font:13px sans-serif;fill:#444}.ink{stroke:#33363d;fill:none;stroke-linecap:round}"
    ".box{fill:#ede6d2;stroke:#33363d;stroke-width:1.5}.dark{fill:#33363d}.rock{fill:#8c8781;stroke:#5d5954}.print{fill:#8d7656;opacity:.45}"
)


@dataclass(frozen=True, slots=True)
class View:
    """One half of the drawing: turns positions relative to the body into picture coordinates."""

    left: float
    zero: float

    def at(self, ahead: float, up: float) -> tuple[float, float]:
        """Picture coordinates of a point *ahead* of the body and *up* in the picture, both in metres."""
        return self.left + (BEHIND + ahead) * SCALE, self.zero - up * SCALE

    def points(self, places: Iterable[Sequence[float]]) -> str:
        """Many points for a polygon or polyline."""
        return " ".join("{:.1f},{:.1f}".format(*self.at(place[0], place[1])) for place in places)


def draw(stance: Stance, terrain: Terrain, trail: Sequence[Foot]) -> str:
    """The picture; both views look along the robot's own axes, which way it may head."""
    width = (BEHIND + AHEAD) * SCALE
    side, above = View(20.0, HEIGHT - SIDE_FLOOR), View(WIDTH - width - 20.0, TOP_MIDDLE)
    parts = [*_from_the_side(side, stance, terrain), *_from_above(above, stance, terrain, trail)]
    clips = "".join(_clip(name, view.left, width) for name, view in (("side", side), ("above", above)))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">'
        f'<style>{STYLE}</style><defs>{clips}</defs><rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>\n'
        + "\n".join(parts)
        + "\n</svg>\n"
    )


def _clip(name: str, left: float, width: float) -> str:
    return f'<clipPath id="{name}"><rect x="{left}" y="30" width="{width}" height="{HEIGHT - 50}" rx="8"/></clipPath>'


def _from_the_side(view: View, stance: Stance, terrain: Terrain) -> list[str]:
    """Seen from the right: ground, far (left) legs first, then body, then near legs."""
    pose, low = stance.pose, BODY_HEIGHT
    floor = pose.height - low
    ahead = np.arange(-BEHIND, AHEAD + 0.2, 0.2)
    x, y = _world_line(pose, ahead, 0.0)
    ground = [*zip(ahead, terrain.heights_at(x, y) - floor, strict=True), (AHEAD, -5.0), (-BEHIND, -5.0)]
    feet = [(foot.leg, _relative(pose, foot.x, foot.y)[0], foot.z - floor) for foot in stance.feet]
    return [
        f'<g clip-path="url(#side)"><rect x="{view.left}" y="30" width="100%" height="100%" fill="#eef3f8"/>',
        *_rocks_from_the_side(view, pose, terrain, floor),
        f'<polygon points="{view.points(ground)}" fill="{SOIL}" stroke="#8d7656"/>',
        *(_leg_from_the_side(view, leg, ahead, z, low) for leg, ahead, z in feet if leg in (0, 1, 2)),
        *_body_from_the_side(view, low),
        *(_leg_from_the_side(view, leg, ahead, z, low) for leg, ahead, z in feet if leg in (3, 4, 5)),
        f'</g><text x="{view.left + 6}" y="22">from the right, x = {pose.x:.1f} m</text>',
    ]


def _rocks_from_the_side(view: View, pose: Pose, terrain: Terrain, floor: float) -> list[str]:
    boxes = []
    for rock in terrain.rocks:
        ahead, _ = _relative(pose, rock.x, rock.y)
        foot, top = terrain.height(rock.x, rock.y) - 0.5, terrain.top(rock)
        boxes.append(_box(view, (ahead - rock.radius, foot - floor), (2 * rock.radius, top - foot), "rock"))
    return boxes


def _body_from_the_side(view: View, low: float) -> list[str]:
    """Shaft, deck, equipment box, scanner on its mast; *low* is the height of the lowest shoulder."""
    return [
        _box(view, (-0.17, low - 0.4), (0.34, 1.7), "dark"),
        _box(view, (-0.48, low + 1.28), (0.95, 0.24), "dark"),
        _box(view, (-0.47, low + 1.52), (0.70, 0.70), "box"),
        _line(view, [(0.3, low + 1.4), (0.75, low + 1.4), (0.75, low + 2.4)], 4),
        _box(view, (0.60, low + 2.35), (0.40, 0.30), "box"),
    ]


def _leg_from_the_side(view: View, leg: int, ahead: float, ground: float, low: float) -> str:
    colour = LEFT_COLOUR if leg in (0, 1, 2) else RIGHT_COLOUR
    level = low + float(SHOULDER_Z[leg])
    beam = _line(view, [(0.0, level), (ahead, level)], 6, colour)
    link = _line(view, [(ahead, ground + 0.1), (ahead, ground + AMBLER.link_length)], 4, colour)
    foot = _box(view, (ahead - 0.22, ground), (0.44, 0.12), "dark")
    return beam + link + foot


def _from_above(view: View, stance: Stance, terrain: Terrain, trail: Sequence[Foot]) -> list[str]:
    """Height bands, footprints, support polygon, legs, stacks and the centre of gravity."""
    pose = stance.pose
    corners = [_relative(pose, x, y) for x, y, _ in support_polygon(stance)]
    centre = view.at(*_relative(pose, *world_centre_of_gravity(stance)[:2]))
    return [
        '<g clip-path="url(#above)">',
        *_height_bands(view, pose, terrain),
        *(_disc(view, _relative(pose, rock.x, rock.y), rock.radius, "rock") for rock in terrain.rocks),
        *(_disc(view, _relative(pose, foot.x, foot.y), 0.2, "print") for foot in trail),
        f'<polygon points="{view.points(corners)}" fill="#3a7d44" fill-opacity=".16" stroke="#3a7d44"/>',
        _box(view, (-0.35, -1.3), (0.7, 2.6), "box"),
        *(_leg_from_above(view, foot.leg, _relative(pose, foot.x, foot.y)) for foot in stance.feet),
        *(_disc(view, (0.0, float(y)), 0.2, "dark") for y in SHAFT_Y[[0, 3]]),
        _line(view, [(0.45, -0.25), (0.75, 0.0), (0.45, 0.25)], 3),
        '<circle cx="{:.1f}" cy="{:.1f}" r="5" fill="#fff" stroke="#3a7d44" stroke-width="3"/>'.format(*centre),
        f'</g><text x="{view.left + 6}" y="22">from above: support polygon, centre of gravity, footprints</text>',
    ]


def _leg_from_above(view: View, leg: int, foot: tuple[float, float]) -> str:
    colour = LEFT_COLOUR if leg in (0, 1, 2) else RIGHT_COLOUR
    x, y = view.at(foot[0], foot[1] + 0.3)
    label = f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{leg}</text>'
    return _line(view, [(0.0, float(SHAFT_Y[leg])), foot], 6, colour) + _disc(view, foot, 0.22, "dark") + label


def _height_bands(view: View, pose: Pose, terrain: Terrain) -> list[str]:
    """Strips of equal stratum, lighter where the ground is higher, row by row across the robot's way."""
    side = 0.125
    rows, columns = np.arange(-BEHIND, AHEAD, side), np.arange(-TOP_MIDDLE / SCALE, TOP_MIDDLE / SCALE, side)
    ahead, left = np.meshgrid(rows + side / 2, columns + side / 2, indexing="ij")
    cos, sin = np.cos(pose.heading), np.sin(pose.heading)
    heights = terrain.heights_at(pose.x + cos * ahead - sin * left, pose.y + sin * ahead + cos * left)
    strata = np.floor((heights - heights.min()) / STRATUM).astype(int)
    strips: dict[str, list[str]] = {}
    for row, levels in zip(rows, strata, strict=True):
        starts = np.flatnonzero(np.diff(levels, prepend=-1))
        for start, end in zip(starts, [*starts[1:], len(levels)], strict=True):
            colour = _soil_colour(levels[start] / max(strata.max(), 1))
            strip = _strip(view, (row, columns[start]), (side, side * (end - start)))
            strips.setdefault(colour, []).append(strip)
    return [f'<path fill="{colour}" d="{"".join(together)}"/>' for colour, together in strips.items()]


def _soil_colour(share: float) -> str:
    red, green, blue = (round(low + share * (high - low)) for low, high in zip(LOW_SOIL, HIGH_SOIL, strict=True))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _strip(view: View, corner: tuple[float, float], size: tuple[float, float]) -> str:
    """A rectangle a little too large, so that no seam is seen: a piece of a path."""
    x, y = view.at(corner[0], corner[1] + size[1])
    width, height = size[0] * SCALE + 0.6, size[1] * SCALE + 0.6
    return f"M{x:.1f} {y:.1f}h{width:.1f}v{height:.1f}h{-width:.1f}z"


def _relative(pose: Pose, x: float, y: float) -> tuple[float, float]:
    """A world point in the robot's own directions, (ahead, left)."""
    cos, sin = np.cos(pose.heading), np.sin(pose.heading)
    dx, dy = x - pose.x, y - pose.y
    return float(cos * dx + sin * dy), float(cos * dy - sin * dx)


def _world_line(pose: Pose, ahead: Array, left: float) -> tuple[Array, Array]:
    x, y = np.array([offset(pose, float(distance), left) for distance in ahead]).T
    return x, y


def _line(view: View, places: Iterable[Sequence[float]], width: int, colour: str = "#33363d") -> str:
    return f'<polyline class="ink" points="{view.points(places)}" style="stroke:{colour};stroke-width:{width}"/>'


def _box(view: View, corner: tuple[float, float], size: tuple[float, float], kind: str) -> str:
    """A box given by its lower left corner."""
    x, y = view.at(corner[0], corner[1] + size[1])
    width, height = size[0] * SCALE, size[1] * SCALE
    return f'<rect class="{kind}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"/>'


def _disc(view: View, centre: tuple[float, float], radius: float, kind: str) -> str:
    x, y = view.at(*centre)
    return f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius * SCALE:.1f}"/>'
