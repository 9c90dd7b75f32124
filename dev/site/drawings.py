"""The drawings of the concept pages: boxes, arrows, bars and words, written as SVG.

The pages contain the SVG itself, so it takes the colour of the text, light or dark.
"""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
    'style="max-width:{width}px;width:100%" font-family="inherit" font-size="14" '
    'fill="currentColor" stroke="none"><title>{title}</title>'
    '<defs><marker id="{name}-tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="9" '
    'markerHeight="9" markerUnits="userSpaceOnUse" orient="auto">'
    '<path d="M0 0 8 4 0 8z" fill="currentColor"/></marker></defs>'
)
BLUE, GREEN, AMBER, RED = "#3b82c4", "#3a9d5d", "#c98a1b", "#cc4b4b"


class Box(NamedTuple):
    """A box with one or more lines of text, centred in it."""

    x: float
    y: float
    width: float
    height: float
    text: str
    colour: str = "currentColor"
    dashed: bool = False

    def svg(self, _: str) -> str:
        """Return the box as SVG."""
        dash = ' stroke-dasharray="5 4"' if self.dashed else ""
        lines = self.text.split("\n")
        top = self.y + self.height / 2 + 5 - 9 * (len(lines) - 1)
        middle = self.x + self.width / 2
        words = "".join(
            f'<text x="{middle}" y="{top + 18 * row}" text-anchor="middle">{escape(line)}</text>'
            for row, line in enumerate(lines)
        )
        return (
            f'<rect x="{self.x}" y="{self.y}" width="{self.width}" height="{self.height}" rx="6" '
            f'fill="{self.colour}" fill-opacity="0.1" stroke="{self.colour}"{dash}/>{words}'
        )


class Arrow(NamedTuple):
    """An arrow between two places, perhaps heavy, with a word beside its middle."""

    x: float
    y: float
    to_x: float
    to_y: float
    text: str = ""
    heavy: bool = False
    dashed: bool = False

    def svg(self, name: str) -> str:
        """Return the arrow as SVG. Its word stands above it, or right of a vertical one."""
        dash = ' stroke-dasharray="5 4"' if self.dashed else ""
        is_vertical = self.x == self.to_x
        x, y = (self.x + self.to_x) / 2 + 8 * is_vertical, (self.y + self.to_y) / 2 - 6
        anchor = "start" if is_vertical else "middle"
        return (
            f'<path d="M{self.x} {self.y} {self.to_x} {self.to_y}" stroke="currentColor" '
            f'stroke-width="{2.5 if self.heavy else 1.2}" marker-end="url(#{name}-tip)"{dash}/>'
            f'<text x="{x}" y="{y}" font-size="12" text-anchor="{anchor}">'
            f"{escape(self.text)}</text>"
        )


class Bar(NamedTuple):
    """An interval on a time axis."""

    x: float
    y: float
    width: float
    colour: str
    text: str = ""

    def svg(self, _: str) -> str:
        """Return the bar as SVG."""
        return (
            f'<rect x="{self.x}" y="{self.y}" width="{self.width}" height="16" rx="3" '
            f'fill="{self.colour}" fill-opacity="0.75"/>'
            f'<text x="{self.x + self.width + 6}" y="{self.y + 13}" font-size="12">'
            f"{escape(self.text)}</text>"
        )


class Words(NamedTuple):
    """Words at a place."""

    x: float
    y: float
    text: str
    size: int = 14

    def svg(self, _: str) -> str:
        """Return the words as SVG."""
        return f'<text x="{self.x}" y="{self.y}" font-size="{self.size}">{escape(self.text)}</text>'


Shape = Box | Arrow | Bar | Words


class Drawing(NamedTuple):
    """A drawing: its name, what it shows, its size and its shapes."""

    name: str
    title: str
    width: int
    height: int
    shapes: Sequence[Shape]

    def svg(self) -> str:
        """Return the drawing as SVG, in one line, so that Markdown leaves it alone."""
        head = HEAD.format(
            width=self.width, height=self.height, title=escape(self.title), name=self.name
        )
        return head + "".join(shape.svg(self.name) for shape in self.shapes) + "</svg>\n"


PACKAGES = Drawing(
    "packages",
    "Programming models stand on the library. Library, central and tools share the wire.",
    680,
    270,
    [
        Box(
            20,
            10,
            640,
            56,
            "tca_behaviours\nmissions · state machines · preview · activities",
            AMBER,
        ),
        Box(20, 110, 200, 56, "tca_module\nthe library", BLUE),
        Box(240, 110, 200, 56, "tca_central\nthe daemon", GREEN),
        Box(460, 110, 200, 56, "tca_tools\nthe command tca"),
        Box(20, 206, 640, 50, "tca_wire: packets, messages, journal"),
        Arrow(120, 66, 120, 108),
        Arrow(120, 166, 120, 204),
        Arrow(340, 166, 340, 204),
        Arrow(560, 166, 560, 204),
        Arrow(460, 138, 442, 138),
    ],
)

TREE = Drawing(
    "tree",
    "A goal with three commands in a sequence",
    680,
    190,
    [
        Box(250, 10, 180, 40, "goal fetch {1}", BLUE),
        Box(20, 120, 180, 40, "command drive {2}", GREEN),
        Box(250, 120, 180, 40, "command grasp {3}", GREEN),
        Box(480, 120, 180, 40, "command drive {4}", GREEN),
        Arrow(290, 50, 130, 118),
        Arrow(340, 50, 340, 118),
        Arrow(390, 50, 550, 118),
        Arrow(200, 140, 248, 140, heavy=True),
        Arrow(430, 140, 478, 140, heavy=True),
        Words(186, 182, "thin arrow: subtask. heavy arrow: achieved before", 12),
    ],
)

INTERVALS = Drawing(
    "intervals",
    "The intervals of a goal and its two commands over time",
    680,
    236,
    [
        Words(10, 28, "goal fetch {1}"),
        Bar(170, 14, 90, BLUE, "handling"),
        Bar(170, 36, 130, AMBER, "planning: fetch and all below it are expanded"),
        Bar(170, 58, 470, GREEN),
        Words(176, 71, "achieving: fetch and all below it are done", 12),
        Words(10, 118, "command drive {2}"),
        Bar(230, 104, 150, BLUE, "handling"),
        Bar(230, 126, 150, GREEN, "achieving"),
        Words(10, 178, "command grasp {3}"),
        Bar(390, 164, 250, BLUE),
        Words(396, 177, "handling", 12),
        Bar(390, 186, 250, GREEN),
        Words(396, 199, "achieving, after drive has been achieved", 12),
        Arrow(170, 222, 660, 222, "", dashed=True),
        Words(10, 227, "time", 12),
    ],
)

RESOURCES = Drawing(
    "resources",
    "Messages queue before a resource with two slots",
    680,
    190,
    [
        Words(20, 24, "waiting, by priority, then by arrival", 12),
        Box(20, 40, 100, 40, "look {9}"),
        Box(130, 40, 100, 40, "look {8}"),
        Box(240, 40, 100, 40, "scan {7}"),
        Arrow(344, 60, 398, 60),
        Box(400, 10, 260, 150, "", BLUE, dashed=True),
        Words(470, 32, "resource camera, capacity 2", 12),
        Box(420, 44, 220, 46, "slot 1: handles look {5}", GREEN),
        Box(420, 102, 220, 46, "slot 2: handles look {6}", GREEN),
        Box(20, 110, 320, 40, "a lock waits until both slots are free", AMBER, dashed=True),
    ],
)

FAILURES = Drawing(
    "failures",
    "The search for an exception handler, from the failing task up to the root",
    680,
    262,
    [
        Box(20, 10, 160, 40, "root"),
        Box(20, 76, 160, 40, "goal fetch {1}", BLUE),
        Box(20, 142, 160, 40, "goal take {2}", BLUE),
        Box(20, 208, 160, 40, "grasp {3} fails", RED),
        Arrow(100, 206, 100, 184, heavy=True),
        Arrow(100, 140, 100, 118, heavy=True),
        Arrow(100, 74, 100, 52, heavy=True),
        Box(260, 208, 190, 40, "handler of this task", AMBER),
        Box(260, 142, 190, 40, "handler of each take", AMBER),
        Box(260, 10, 190, 40, "handler of any failure", AMBER),
        Arrow(182, 228, 258, 228, "1"),
        Arrow(182, 162, 258, 162, "2"),
        Arrow(182, 30, 258, 30, "3"),
        Words(478, 233, "retry(): handle grasp again", 12),
        Words(478, 167, "kill(): end take with all below", 12),
        Words(478, 35, "resolved(): call it done", 12),
        Words(478, 96, "None of these:", 12),
        Words(478, 114, "the search continues upwards", 12),
    ],
)

MONITORS = Drawing(
    "monitors",
    "A wiretap holds a message for a check. A monitor asks a query and sends an action.",
    680,
    220,
    [
        Box(20, 20, 120, 40, "move {4}", GREEN),
        Arrow(142, 40, 238, 40, "held"),
        Box(240, 20, 150, 40, "wiretap on move", AMBER),
        Arrow(392, 40, 518, 40, "then handled"),
        Box(520, 20, 140, 40, "legs"),
        Arrow(315, 62, 315, 96, "sends"),
        Box(240, 98, 150, 40, "check {5}", BLUE),
        Box(20, 168, 180, 40, "monitor battery {6}", AMBER),
        Arrow(202, 188, 298, 188, "every 1 s"),
        Box(300, 168, 150, 40, "query: is it low?", BLUE),
        Arrow(452, 188, 518, 188, "yes"),
        Box(520, 168, 140, 40, "goal charge {7}", GREEN),
    ],
)

SURVIVAL = Drawing(
    "survival",
    "Programs on the left, central in the middle, its files on the right",
    680,
    200,
    [
        Box(20, 20, 150, 40, "planner", BLUE),
        Box(20, 80, 150, 40, "arm", BLUE),
        Box(20, 140, 150, 40, "your script", BLUE, dashed=True),
        Box(260, 50, 140, 100, "central\ntasks, queues,\nlocks, monitors", GREEN),
        Box(490, 20, 170, 40, "inputs"),
        Box(490, 80, 170, 40, "images of the state"),
        Box(490, 140, 170, 40, "journal, for tools"),
        Arrow(172, 40, 258, 76),
        Arrow(172, 100, 258, 100),
        Arrow(172, 160, 258, 124),
        Arrow(402, 76, 488, 40),
        Arrow(402, 100, 488, 100),
        Arrow(402, 124, 488, 160),
    ],
)

REPLICATION = Drawing(
    "replication",
    "The leader appends inputs to the log on three servers, and standbys read them",
    680,
    230,
    [
        Box(10, 90, 110, 40, "modules", BLUE),
        Arrow(122, 102, 188, 102, "input"),
        Arrow(188, 122, 122, 122, "", dashed=True),
        Box(190, 80, 130, 60, "leader\na central", GREEN),
        Arrow(322, 110, 388, 110, "append", heavy=True),
        Box(390, 20, 110, 180, "", AMBER, dashed=True),
        Words(420, 38, "the log", 12),
        Box(402, 48, 86, 36, "server 1", AMBER),
        Box(402, 98, 86, 36, "server 2", AMBER),
        Box(402, 148, 86, 36, "server 3", AMBER),
        Arrow(502, 76, 558, 60, "read"),
        Arrow(502, 144, 558, 160, "read"),
        Box(560, 30, 110, 50, "standby\na central", GREEN, dashed=True),
        Box(560, 140, 110, 50, "standby\na central", GREEN, dashed=True),
        Words(10, 220, "The answer (dashed) leaves after two servers have the input.", 12),
    ],
)

DRAWINGS = (PACKAGES, TREE, INTERVALS, RESOURCES, FAILURES, MONITORS, SURVIVAL, REPLICATION)


def write(folder: Path) -> None:
    """Write all drawings into *folder*."""
    folder.mkdir(parents=True, exist_ok=True)
    for drawing in DRAWINGS:
        (folder / f"{drawing.name}.svg").write_text(drawing.svg())
