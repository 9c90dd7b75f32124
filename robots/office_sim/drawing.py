"""The lab from above, as an SVG picture: the robot's way, and the end of each cup. Pure."""

from collections.abc import Iterable

from robots.drawing import Place, View
from robots.office_sim.messages import REACH
from robots.office_sim.paths import RADIUS
from robots.office_sim.vocabulary import Block, CupState, LabScene, Spot
from tca_tools.drawing.svg import document, text

SCALE = 80.0
"""Pixels per metre."""

MARGIN, TOP, BELOW = 24.0, 44.0, 64.0
CUP = 9.0
"""The radius of a cup in pixels, larger than to scale so that it is visible."""

STYLE = """\
.floor { fill: #f6f4ef; stroke: #3e4c59; stroke-width: 5; } .wall { fill: #3e4c59; }
.table { fill: #d9c6a5; stroke: #9c865d; } .bin { fill: #b8c4ce; stroke: #52606d; stroke-width: 2; }
.charger { fill: #ffe58a; stroke: #b58900; stroke-width: 2; }
.reach { fill: none; stroke: #b8c4ce; stroke-dasharray: 3 4; }
.way { fill: none; stroke: #8a99a8; stroke-width: 1.5; }
.way { stroke-linejoin: round; stroke-dasharray: 6 4; }
.carrying { fill: none; stroke: #2c9a57; stroke-width: 2.5; }
.carrying { stroke-linejoin: round; stroke-opacity: 0.7; }
.robot { fill: #e8792b; stroke: #33363d; stroke-width: 1.5; fill-opacity: 0.85; }
.collected { fill: #2c9a57; stroke: #1b5f36; }
.taken { fill: #fff; stroke: #c0392b; stroke-width: 2; }
.left { fill: #f0a500; stroke: #8a5a00; } .cross { stroke: #c0392b; stroke-width: 2; }
.number { font-size: 10px; text-anchor: middle; } .light { fill: #fff; }
"""

LOOKS = {
    CupState.BIN: "collected",
    CupState.TAKEN: "taken",
    CupState.FLOOR: "left",
    CupState.HAND: "left",
}
"""The look of a cup in each state. A cup that has not fallen is not drawn."""
CUPS = {
    "collected": "collected, where it lay",
    "taken": "taken by a person",
    "left": "left on the floor",
}
WAYS = {"way": "on the way to a cup", "carrying": "with a cup"}


def draw(scene: LabScene, title: str) -> str:
    """Draw the lab."""
    floor = scene.floor
    view = View(MARGIN, TOP + floor.depth * SCALE, SCALE)
    heading = f"{title}: {describe_result(scene)}"
    body = [
        f'<text class="title" x="{MARGIN:.0f}" y="26">{text(heading)}</text>',
        _block(view, "floor", Block(0.0, 0.0, floor.width, floor.depth)),
        *(_block(view, "table", table) for table in floor.tables),
        *(_block(view, "wall", wall) for wall in floor.walls),
        view.disc("reach", _place(floor.bin), REACH),
        view.disc("bin", _place(floor.bin), 0.2),
        view.words("bin", _place(floor.bin), down=4, class_="number"),
        _block(view, "charger", floor.charger.around(0.2)),
        view.words("charger", (floor.charger.x, floor.charger.y - 0.35), down=4, class_="number"),
        *(
            view.line("carrying" if stretch.with_cup else "way", map(_place, stretch.points))
            for stretch in scene.trail
            if len(stretch.points) > 1
        ),
        *(
            part
            for cup in scene.cups
            if cup.state in LOOKS
            for part in _cup(view, LOOKS[cup.state], _place(cup.spot), f"{cup.number}")
        ),
        view.disc("robot", _place(scene.robot), RADIUS),
        *_legend(View(MARGIN, TOP + floor.depth * SCALE + 30, 1.0)),
    ]
    width, height = floor.width * SCALE + 2 * MARGIN, TOP + floor.depth * SCALE + BELOW
    return document(width, height, f"{title}: the lab from above", STYLE, body)


def describe_result(scene: LabScene) -> str:
    """Describe the result in one line."""
    looks = [LOOKS[cup.state] for cup in scene.cups if cup.state in LOOKS]
    collected, taken, left = map(looks.count, CUPS)
    cups = (
        f"{len(looks)} cups in {scene.time:.0f} s, {collected} collected,"
        f" {taken} taken by people, {left} left"
    )
    return f"{cups}; charged {scene.charges} time{'s' * (scene.charges != 1)}"


def _place(spot: Spot) -> Place:
    return spot.x, spot.y


def _block(view: View, look: str, block: Block) -> str:
    return view.box(
        look, (block.left, block.bottom), block.right - block.left, block.top - block.bottom
    )


def _cup(view: View, look: str, place: Place, number: str) -> Iterable[str]:
    """Yield the parts of a cup with its number. A cup that a person picked up is crossed out."""
    yield view.disc(look, place, CUP / view.scale)
    beside = 0.0
    if look == "taken":
        half, (x, y) = 7 / view.scale, place
        yield view.line("cross", [(x - half, y - half), (x + half, y + half)])
        beside = CUP + 8
    yield view.words(
        number, place, right=beside, down=3.5, class_="number" + " light" * (look == "collected")
    )


def _legend(view: View) -> Iterable[str]:
    """Yield the parts of the legend: all looks, in one row. *view* is in pixels."""
    x = CUP
    for look, words in CUPS.items():
        yield from _cup(view, look, (x, 0.0), "")
        yield view.words(words, (x, 0.0), right=CUP + 7, down=4)
        x += 6 * len(words) + 42
    for look, words in WAYS.items():
        yield view.line(look, [(x, 0.0), (x + 28, 0.0)])
        yield view.words(words, (x, 0.0), right=34, down=4)
        x += 6 * len(words) + 50
    yield view.disc("robot", (x, 0.0), CUP)
    yield view.words("the robot", (x, 0.0), right=CUP + 6, down=4)
