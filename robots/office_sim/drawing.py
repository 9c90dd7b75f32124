"""The lab from above, as an SVG picture: the robot's way, and what became of each cup. Pure."""

from collections.abc import Iterable

from robots.office_sim.messages import REACH
from robots.office_sim.paths import RADIUS
from robots.office_sim.vocabulary import Block, CupState, FloorPlan, LabScene, Spot, Stretch
from tca_tools.drawing.svg import document, text

SCALE = 80.0
"""Pixels a metre."""

MARGIN, TOP, BELOW = 24.0, 44.0, 64.0
CUP = 9.0
"""Pixels of a cup's radius: more than it has, to be seen."""

STYLE = """\
.floor { fill: #f6f4ef; stroke: #3e4c59; stroke-width: 5; } .wall { fill: #3e4c59; }
.table { fill: #d9c6a5; stroke: #9c865d; } .bin { fill: #b8c4ce; stroke: #52606d; stroke-width: 2; }
.charger { fill: #ffe58a; stroke: #b58900; stroke-width: 2; }
.reach { fill: none; stroke: #b8c4ce; stroke-dasharray: 3 4; }
.way { fill: none; stroke: #8a99a8; stroke-width: 1.5; stroke-linejoin: round; stroke-dasharray: 6 4; }
.carrying { fill: none; stroke: #2c9a57; stroke-width: 2.5; stroke-linejoin: round; stroke-opacity: 0.7; }
.robot { fill: #e8792b; stroke: #33363d; stroke-width: 1.5; fill-opacity: 0.85; }
.collected { fill: #2c9a57; stroke: #1b5f36; } .taken { fill: #fff; stroke: #c0392b; stroke-width: 2; }
.left { fill: #f0a500; stroke: #8a5a00; } .cross { stroke: #c0392b; stroke-width: 2; }
.number { font-size: 10px; text-anchor: middle; } .light { fill: #fff; }
"""

LOOKS = {CupState.BIN: "collected", CupState.TAKEN: "taken", CupState.FLOOR: "left", CupState.HAND: "left"}
"""How a cup is drawn; one that is still to come is not."""
CUPS = {"collected": "collected, where it lay", "taken": "taken by somebody", "left": "left on the floor"}
WAYS = {"way": "on the way to a cup", "carrying": "with a cup"}


def draw(scene: LabScene, title: str) -> str:
    """The picture, as text."""
    floor, place = scene.floor, _LabMap(scene.floor)
    cups = [cup for cup in scene.cups if cup.state in LOOKS]
    body = [
        f'<text class="title" x="{MARGIN:.0f}" y="26">{text(f"{title}: {in_words(scene)}")}</text>',
        place.rectangle("floor", Block(0.0, 0.0, floor.width, floor.depth)),
        *(place.rectangle("table", table) for table in floor.tables),
        *(place.rectangle("wall", wall) for wall in floor.walls),
        place.circle("reach", floor.bin, REACH * SCALE),
        place.circle("bin", floor.bin, 0.2 * SCALE),
        place.label(floor.bin, "bin"),
        place.rectangle("charger", floor.charger.around(0.2)),
        place.label(Spot(floor.charger.x, floor.charger.y - 0.35), "charger"),
        *(place.way(stretch) for stretch in scene.trail if len(stretch.points) > 1),
        *(part for cup in cups for part in _cup(LOOKS[cup.state], *place.at(cup.spot), str(cup.number))),
        place.circle("robot", scene.robot, RADIUS * SCALE),
        *_legend(floor),
    ]
    return document(
        floor.width * SCALE + 2 * MARGIN, TOP + floor.depth * SCALE + BELOW, f"{title}: the lab from above", STYLE, body
    )


def in_words(scene: LabScene) -> str:
    """What came of it, in one line."""
    became = [LOOKS[cup.state] for cup in scene.cups if cup.state in LOOKS]
    collected, taken, left = map(became.count, CUPS)
    cups = f"{len(became)} cups in {scene.time:.0f} s, {collected} collected, {taken} taken by people, {left} left"
    return f"{cups}; charged {scene.charges} time{'s' * (scene.charges != 1)}"


class _LabMap:
    """Where the places of a floor are in the picture; its y axis goes up."""

    def __init__(self, floor: FloorPlan) -> None:
        self._depth = floor.depth

    def at(self, spot: Spot) -> tuple[float, float]:
        return MARGIN + spot.x * SCALE, TOP + (self._depth - spot.y) * SCALE

    def rectangle(self, look: str, block: Block) -> str:
        left, top = self.at(Spot(block.left, block.top))
        size = f'width="{(block.right - block.left) * SCALE:.1f}" height="{(block.top - block.bottom) * SCALE:.1f}"'
        return f'<rect class="{look}" x="{left:.1f}" y="{top:.1f}" {size}/>'

    def circle(self, look: str, spot: Spot, radius: float) -> str:
        x, y = self.at(spot)
        return _circle(look, x, y, radius)

    def label(self, spot: Spot, words: str) -> str:
        x, y = self.at(spot)
        return f'<text class="number" x="{x:.1f}" y="{y + 4:.1f}">{words}</text>'

    def way(self, stretch: Stretch) -> str:
        points = " ".join("{:.1f},{:.1f}".format(*self.at(spot)) for spot in stretch.points)
        return f'<polyline class="{"carrying" if stretch.with_cup else "way"}" points="{points}"/>'


def _circle(look: str, x: float, y: float, radius: float) -> str:
    return f'<circle class="{look}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"/>'


def _cup(look: str, x: float, y: float, number: str) -> Iterable[str]:
    """A cup with its number; one that somebody took is crossed out."""
    yield _circle(look, x, y, CUP)
    if look == "taken":
        yield f'<path class="cross" d="M{x - 7:.1f},{y + 7:.1f} L{x + 7:.1f},{y - 7:.1f}"/>'
        x += CUP + 8
    light = " light" * (look == "collected")
    yield f'<text class="number{light}" x="{x:.1f}" y="{y + 3.5:.1f}">{number}</text>'


def _legend(floor: FloorPlan) -> Iterable[str]:
    x, y = MARGIN + CUP, TOP + floor.depth * SCALE + 30
    for look, words in CUPS.items():
        yield from _cup(look, x, y, "")
        yield f'<text x="{x + CUP + 7:.1f}" y="{y + 4:.1f}">{words}</text>'
        x += 6 * len(words) + 42
    for look, words in WAYS.items():
        yield f'<polyline class="{look}" points="{x:.1f},{y:.1f} {x + 28:.1f},{y:.1f}"/>'
        yield f'<text x="{x + 34:.1f}" y="{y + 4:.1f}">{words}</text>'
        x += 6 * len(words) + 50
    yield _circle("robot", x, y, CUP)
    yield f'<text x="{x + CUP + 6:.1f}" y="{y + 4:.1f}">the robot</text>'
