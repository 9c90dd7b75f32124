"""Where everything stands in the picture of an outline: a line a task, indented, beside the times it took. Pure.

For trees that are too wide to be drawn as a figure: this one grows downwards only.
"""

from dataclasses import dataclass, field
from textwrap import wrap

from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.records import TaskState
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import SEQ, ArrowKind, Arrows, in_words
from tca_tools.tasktree_viz.lanes import Line, lines
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import columns_of, cut, cut_name
from tca_wire.points import Interval
from tca_wire.text.printable import printable

INDENT, DEEPEST = 22.0, 420.0
"""Pixels: of a level and, as many levels as there are, of all together."""
LANE = 6.0
"""Between two lanes; the nearest is half an indentation away from the boxes."""
_LEAST_INDENT = INDENT / 2
"""Where a level has less room, lines of one would run into those of the next: all is said in words."""
CHARACTER, LINE, BOX = 6.7, 15.0, 19.0
_ROW, _NOTE_CHARACTER = 25.0, 5.6
_LONGEST_NAME, _NOTE_COLUMNS, _NOTE_LINES = 44, 54, 3
_LONGEST_DATA = 160
_LONGEST_AFTER = 100


@dataclass(slots=True)
class Placement:
    """One line of the picture."""

    row: Row
    left: float
    """Of its box."""
    top: float
    width: float
    """Of its box."""
    label: str
    notes: list[str] = field(default_factory=list)
    """The lines beside the box: its state, the reason why it waits or failed, its data."""
    after: str = ""
    """Its constraints that no line to it shows."""
    planning: tuple[float, float | None] | None = None
    achieving: tuple[float, float | None] | None = None


@dataclass(slots=True)
class Plan:
    """All lines, and how large they are together."""

    places: list[Placement]
    width: float
    """Of the boxes with what stands right beside them."""
    height: float
    notes_width: float
    indent: float
    lines: list[Line]
    """From tasks to brothers that wait for them, in lanes."""


def plan(at: RunAt, rows: list[Row], found: Arrows, *, with_data: bool) -> Plan:
    """Where the rows stand. Names and notes are cut to fit."""
    indent = min(INDENT, DEEPEST / max(max((row.depth for row in rows), default=0), 1))
    drawn = _lines(rows, found) if indent >= _LEAST_INDENT else []
    shifts: dict[int, float] = {}
    for line in drawn:
        parent = rows[line.to[0]].parent
        shifts[parent] = max(shifts.get(parent, 0.0), line.lane * LANE)
    places: list[Placement] = []
    top = 0.0
    for row in rows:
        label = cut_name(printable(str(row.task)), row.task.id, _LONGEST_NAME) if row.task else words.folded(row)
        above = places[row.parent].left if row.parent >= 0 else 0.0
        left = above + indent + shifts.get(row.parent, 0.0)
        place = Placement(row, left, top, columns_of(label) * CHARACTER + 14, label)
        if row.task:
            _tell(place, at, row.task, with_data)
        places.append(place)
        top += max(_ROW, len(place.notes) * LINE + 8)
    lines_of = {(rows[one].task, rows[to].task) for line in drawn for to in line.to for one in line.sources}
    has_line = {(int(one.id), int(to.id)): [ArrowKind(SEQ)] for one, to in lines_of if one and to}
    said = in_words(at, found, has_line)
    for place in places:
        if place.row.task:
            place.after = cut(printable("; ".join(said.get(place.row.task.id, []))), _LONGEST_AFTER)
    width = max((place.left + place.width + columns_of(place.after) * 5.5 + 12 for place in places), default=0.0)
    notes = max((columns_of(note) for place in places for note in place.notes), default=0)
    return Plan(places, width, top, notes * _NOTE_CHARACTER, indent, drawn)


def _tell(place: Placement, at: RunAt, task: TaskAt, with_data: bool) -> None:
    note = words.with_state(at, task, words.note_of(at, task))
    place.notes = words.lines_of(note, _NOTE_COLUMNS, _NOTE_LINES)
    if with_data and (data := words.data(task)):
        place.notes += wrap(cut(data, _LONGEST_DATA), _NOTE_COLUMNS)
    place.planning = words.span(task, Interval.PLANNING)
    place.achieving = words.span(task, Interval.ACHIEVING)
    if place.planning == place.achieving and task.state is not TaskState.PLANNING:
        place.planning = None


def _lines(rows: list[Row], found: Arrows) -> list[Line]:
    """The lines between brothers, family by family."""
    numbers = {int(row.task.id): row.number for row in rows if row.task}
    families: dict[int, list[tuple[int, int]]] = {}
    for (first, second), kinds in found.between.items():
        one, other = numbers[first], numbers[second]
        if SEQ in kinds and one < other and rows[one].parent == rows[other].parent:
            families.setdefault(rows[one].parent, []).append((one, other))
    return [line for pairs in families.values() for line in lines(pairs)]
