"""Where everything stands in the picture of an outline: a line a task, indented, beside the times it took. Pure.

For trees that are too wide to be drawn as a figure: this one grows downwards only.
"""

from dataclasses import dataclass, field
from textwrap import wrap

from tca_tools.records import State
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import SEQ, Arrows
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import columns_of, cut
from tca_tools.then import TaskThen, Then
from tca_wire.lines import printable
from tca_wire.points import Interval

INDENT, DEEPEST = 22.0, 420.0
"""Pixels: of a level and, as many levels as there are, of all together."""
CHARACTER, LINE, BOX = 6.7, 15.0, 19.0
_ROW, _NOTE_CHARACTER = 25.0, 5.6
_LONGEST_NAME, _NOTE_COLUMNS, _NOTE_LINES = 44, 54, 3
_LONGEST_DATA = 160
_LONGEST_AFTER = 100


@dataclass(slots=True)
class Place:
    """One line of the picture."""

    row: Row
    left: float
    """Of its box."""
    top: float
    width: float
    """Of its box."""
    label: str
    notes: list[str] = field(default_factory=list)
    """What stands beside it, line by line: its state, what it waits for, how it failed, its data."""
    after: str = ""
    """Its constraints that no line to it shows."""
    planning: tuple[float, float | None] | None = None
    achieving: tuple[float, float | None] | None = None


@dataclass(slots=True)
class Plan:
    """All lines, and how large they are together."""

    places: list[Place]
    width: float
    """Of the boxes with what stands right beside them."""
    height: float
    notes_width: float
    indent: float
    before: dict[int, int]
    """For rows whose task comes after a brother's: the number of that one's row."""


def plan(then: Then, rows: list[Row], found: Arrows, *, with_data: bool) -> Plan:
    """Where the rows stand. Names and notes are cut to fit."""
    indent = min(INDENT, DEEPEST / max(max((row.depth for row in rows), default=0), 1))
    places: list[Place] = []
    top = 0.0
    for row in rows:
        label = cut(printable(str(row.task)), _LONGEST_NAME) if row.task else words.folded(row)
        place = Place(row, (row.depth + 1) * indent, top, columns_of(label) * CHARACTER + 14, label)
        if row.task:
            _tell(place, then, row.task, with_data)
        places.append(place)
        top += max(_ROW, len(place.notes) * LINE + 8)
    before = _brothers(then, rows, places, found)
    width = max((place.left + place.width + columns_of(place.after) * 5.5 + 12 for place in places), default=0.0)
    notes = max((columns_of(note) for place in places for note in place.notes), default=0)
    return Plan(places, width, top, notes * _NOTE_CHARACTER, indent, before)


def _tell(place: Place, then: Then, task: TaskThen, with_data: bool) -> None:
    note = words.note(then, task)
    place.notes = wrap(_state_and(note, task), _NOTE_COLUMNS, max_lines=_NOTE_LINES, placeholder="…")
    if with_data and (data := words.data(task)):
        place.notes += wrap(cut(data, _LONGEST_DATA), _NOTE_COLUMNS)
    place.planning = words.span(task, Interval.PLANNING)
    place.achieving = words.span(task, Interval.ACHIEVING)
    if place.planning == place.achieving and task.state is not State.PLANNING:
        place.planning = None


def _state_and(note: str, task: TaskThen) -> str:
    """``held, waits until ...``, ``failed: slip``."""
    if not note:
        return task.standing
    if note.startswith(task.standing):  # "suspended by user, until ..."
        return note
    if task.state in (State.FAILED, State.KILLED, State.ENDING):
        return f"{task.standing}: {note}"
    says_how = task.failure and task.state is not State.RECOVERING
    return f"{task.state}, failed: {note}" if says_how else f"{task.state}, {note}"


def _brothers(then: Then, rows: list[Row], places: list[Place], found: Arrows) -> dict[int, int]:
    """The lines between brothers, and in words what they don't say."""
    numbers = {int(row.task.id): row.number for row in rows if row.task}
    before: dict[int, int] = {}
    words_of: dict[int, list[str]] = {}
    for (first, second), kinds in found.between.items():
        one, other = numbers[first], numbers[second]
        is_drawn = rows[one].parent == rows[other].parent and one < other
        if is_drawn:
            before[other] = max(one, before.get(other, -1))
        if not is_drawn or kinds != [SEQ]:
            told = ", ".join(kind for kind in kinds if not (is_drawn and kind == SEQ))
            words_of.setdefault(other, []).append(f"{told} ({'' if is_drawn else 'after '}{then.describe(first)})")
    for task, kinds in found.own.items():
        words_of.setdefault(numbers[task], []).insert(0, ", ".join(kinds))
    for number, said in words_of.items():
        places[number].after = cut(printable("; ".join(said)), _LONGEST_AFTER)
    return before
