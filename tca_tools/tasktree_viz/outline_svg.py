"""A wide tree as an SVG picture that grows only downwards.

Each task has one line with guides, its waits, and bars of its times.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from textwrap import wrap

from tca_tools.drawing import svg
from tca_tools.gantt.axis import Scale, ticks
from tca_tools.gantt.legend import legend
from tca_tools.gantt.looks import MARGIN
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.fates import STANDINGS
from tca_tools.journal.records import OVER, TaskState
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import MEANINGS, SEQ, ArrowKind, Arrows, arrows, in_words
from tca_tools.tasktree_viz.dot import FILLS, border_of, borders
from tca_tools.tasktree_viz.lanes import Line, lines
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import columns_of, cut, cut_name
from tca_wire.points import ROOT, Interval
from tca_wire.text.measures import from_to
from tca_wire.text.printable import printable

CHARACTER, _NOTE_CHARACTER, _AFTER_CHARACTER = 6.7, 5.6, 5.5
_LINE, _BOX, _ROW, _GAP, _TIMES = 15.0, 19.0, 25.0, 18.0, 460.0
_INDENT, _DEEPEST, _LANE = 22.0, 420.0, 6.0
"""Pixels: of one level, of all levels together, and between two lanes of lines."""
_LEAST_INDENT = _INDENT / 2
"""Pixels: with less, lines of neighbouring levels would touch, so words replace all lines."""
_LONGEST_NAME, _LONGEST_DATA, _LONGEST_AFTER, _NOTE_COLUMNS, _NOTE_LINES = 44, 160, 100, 54, 3
_TICK_DISTANCE = 80.0
_ENTRY, _ROUND = 4.5, 4.0
"""Pixels: from the top of a box to the end of a line, and the radius of a turn."""
_STYLE = Path(__file__).with_name("outline.css").read_text()
_JOINED = "; a line from several tasks: all of them before all tasks that it leads to"


def outline_svg(at: RunAt, rows: list[Row], title: str, *, with_data: bool = False) -> str:
    """Return the whole picture as an SVG document."""
    found = arrows(at, {row.task.id for row in rows if row.task})
    picture = _Picture(at, rows, found, with_data=with_data)
    head, top = picture.head(title, found.kinds)
    bottom = top + 26 + picture.height
    body = [*head, *picture.axis(top, bottom - 4), *picture.body(top + 26)]
    return svg.document(picture.right + MARGIN, bottom + MARGIN, title, _STYLE, body)


@dataclass(slots=True)
class _Placement:
    """One line of the picture."""

    row: Row
    left: float
    """The left end of its box."""
    top: float
    label: str
    notes: list[str] = field(default_factory=list)
    """The lines beside the box: its state, the reason of its wait or failure, its data."""
    after: str = ""
    """The constraints that are shown in words, without a line."""

    @property
    def right(self) -> float:
        """The right end of its box."""
        return self.left + columns_of(self.label) * CHARACTER + 14


class _Picture:
    """The layout of boxes, notes and bars on an axis of time, and their drawing."""

    def __init__(self, at: RunAt, rows: list[Row], found: Arrows, *, with_data: bool) -> None:
        self._at, self._rows = at, rows
        deepest = max((row.depth for row in rows), default=0)
        self._indent = min(_INDENT, _DEEPEST / max(deepest, 1))
        self._lines = _lines(rows, found) if self._indent >= _LEAST_INDENT else []
        self._places: list[_Placement] = []
        self.height = 0.0
        self._place_rows(with_data)
        self._add_words(found)
        places = self._places
        ends = [one.right + columns_of(one.after) * _AFTER_CHARACTER + 12 for one in places]
        notes = [columns_of(note) for one in places for note in one.notes]
        self._notes = max(ends, default=MARGIN) + _GAP
        self._times = self._notes + max(notes, default=0) * _NOTE_CHARACTER + _GAP
        self.right = self._times + _TIMES
        spans = [_span(at, row.task) for row in rows if row.task]
        start = min((begin for begin, _ in spans), default=0.0)
        self._scale = Scale(_TIMES, start, max((end for _, end in spans), default=at.time))

    def _place_rows(self, with_data: bool) -> None:
        """Place the rows one below the other. Names and notes are cut to fit."""
        shifts: dict[int, float] = {}
        for line in self._lines:
            parent = self._rows[line.targets[0]].parent
            shifts[parent] = max(shifts.get(parent, 0.0), line.lane * _LANE)
        for row in self._rows:
            task = row.task
            label = words.folded(row)
            if task:
                label = cut_name(printable(str(task)), task.id, _LONGEST_NAME)
            above = self._places[row.parent].left if row.parent >= 0 else MARGIN
            left = above + self._indent + shifts.get(row.parent, 0.0)
            notes = list(_notes(self._at, task, with_data)) if task else []
            self._places.append(_Placement(row, left, self.height, label, notes))
            self.height += max(_ROW, len(notes) * _LINE + 8)

    def _add_words(self, found: Arrows) -> None:
        """Put constraints that have no line into words."""
        tasks = [row.task.id if row.task else ROOT for row in self._rows]
        pairs = [pair for line in self._lines for pair in line.pairs]
        drawn = {(int(tasks[one]), int(tasks[to])): [ArrowKind(SEQ)] for one, to in pairs}
        texts = in_words(self._at, found, drawn)
        for place in self._places:
            if place.row.task:
                text = printable("; ".join(texts.get(place.row.task.id, [])))
                place.after = cut(text, _LONGEST_AFTER)

    def head(self, title: str, kinds: set[str]) -> tuple[list[str], float]:
        """Return the title with the meanings of colours and lines, and its bottom."""
        rows = self._rows
        states = {row.task.standing if row.task else row.state for row in rows}
        shown = [state for state in STANDINGS if state in states]
        items = [(f'fill="{FILLS[state]}" stroke="#52606d"', str(state)) for state in shown]
        items.append(('class="planning"', "the time of its planning"))
        items += [
            (f'fill="#ffffff" stroke="{colour}" stroke-width="2.2"', of)
            for colour, of in borders(rows)
        ]
        squares, y = legend(items, self.right, MARGIN + 20)
        joined = _JOINED if any(len(line.sources) > 1 for line in self._lines) else ""
        after = " and ".join(["heavy lines"] * bool(self._lines) + ['"after"'])
        meanings = [(after, MEANINGS[SEQ] + joined)] * (SEQ in kinds)
        meanings += [("dashed, with +", words.FOLDED_UP)] * any(row.folded for row in rows)
        meanings += [(kind, MEANINGS[kind]) for kind in MEANINGS if kind in kinds - {SEQ}]
        head = [svg.words("title", MARGIN, MARGIN + 6, title), *squares]
        for what, meaning in meanings:
            head.append(svg.words("kind", MARGIN, y + 4, f"{what}: {meaning}"))
            y += _LINE
        return head, y + 8

    def axis(self, top: float, bottom: float) -> Iterator[str]:
        """Yield the axis above, and the grid lines below it."""
        for time, label in ticks(self._scale.start, self._scale.end, int(_TIMES / _TICK_DISTANCE)):
            x = self._times + self._scale.x(time)
            yield svg.line("grid", x, top + 14, x, bottom)
            yield svg.words("faint tick", x, top + 9, label)

    def body(self, top: float) -> Iterator[str]:
        """Yield all rows and the lines between them."""
        for place in self._places:
            if place.row.task:
                yield from self._beside(place, place.row.task, top + place.top)
        yield from self._guides(top)
        yield from self._heavy(top)
        for place in self._places:
            yield from self._box(place, top + place.top)

    def _beside(self, place: _Placement, task: TaskAt, y: float) -> Iterator[str]:
        """Yield the notes and bars of one task."""
        for number, note in enumerate(place.notes):
            yield svg.words("note", self._notes, y + 13 + number * _LINE, note)
        planning, achieving = (
            words.span(task, one) for one in (Interval.PLANNING, Interval.ACHIEVING)
        )
        if planning and (planning != achieving or task.state is TaskState.PLANNING):
            yield self._bar(f"{task}: planning", planning, 'class="planning"', y + 1, 5)
        if achieving:
            look = f'fill="{FILLS[task.standing]}" stroke="#52606d" stroke-width="0.7"'
            yield self._bar(f"{task}: achieving", achieving, look, y + 6, 10)

    def _bar(
        self, what: str, span: tuple[float, float | None], look: str, y: float, height: float
    ) -> str:
        start, end = span
        left = self._times + self._scale.x(start)
        right = self._times + self._scale.x(self._scale.end if end is None else end)
        title = f"{what} {from_to(start, end)}"
        return svg.rectangle(look, left, y, max(right, left + 1.5), height, title)

    def _guides(self, top: float) -> Iterator[str]:
        """Yield thin lines from each task to its children."""
        for place in self._places:
            if place.row.parent >= 0:
                above = self._places[place.row.parent]
                x, y = above.left + self._indent / 2, top + place.top + _BOX / 2
                path = f"M{x:.1f} {top + above.top + _BOX:.1f} V{y:.1f} H{place.left:.1f}"
                yield f'<path class="guide" d="{path}"/>'

    def _heavy(self, top: float) -> Iterator[str]:
        """Yield heavy lines to tasks that come after their siblings.

        A line leaves a box below the entries of other lines.
        """
        all_leaving = Counter(source for line in self._lines for source in line.sources)
        leaving: Counter[int] = Counter()
        tips: list[str] = []
        # outer lines cross inner ones, and are drawn over them
        for line in sorted(self._lines, key=attrgetter("lane")):
            leaving.update(line.sources)
            share = {
                source: 1 - leaving[source] / (all_leaving[source] + 1) for source in line.sources
            }
            entry = top + _ENTRY
            starts = [
                entry + self._places[number].top + (_BOX - _ENTRY) * part
                for number, part in share.items()
            ]
            ends = [entry + self._places[number].top for number in line.targets]
            left = self._places[line.targets[0]].left
            x = left - self._indent / 2 - line.lane * _LANE
            if line.lane:  # inner lines are interrupted where this line crosses them
                across = " ".join(
                    f"M{left:.1f} {y:.1f} H{x + _ROUND:.1f}" for y in (*starts, *ends)
                )
                yield f'<path class="over" d="{across}"/>'
            yield f'<path class="heavy" d="{_path(x, left, starts, ends)}"/>'
            tips += [f'<path class="tip" d="M{left:.1f} {y:.1f} l-8 -4 v8 z"/>' for y in ends]
        yield from tips

    def _box(self, place: _Placement, y: float) -> Iterator[str]:
        task, left = place.row.task, place.left
        if task is None:
            look = f'fill="{FILLS.get(place.row.state, "#ffffff")}" '
            look += 'stroke="#1f2933" stroke-dasharray="3 2"'
        else:
            border = border_of(task)
            look = f'fill="{FILLS[task.standing]}" '
            look += f'stroke="{border[0]}" stroke-width="2.2"' if border else 'stroke="#1f2933"'
            look += ' rx="7"' if task.message_class.is_goal else ""
            look += ' stroke-dasharray="4 3"' if task.state is TaskState.HELD else ""
        title = words.tooltip(self._at, task) if task else place.label
        yield svg.rectangle(look, left, y, place.right, _BOX, title)
        yield svg.words("name", left + 7, y + 13.5, place.label, svg.UNTOUCHED)
        if place.after:
            yield svg.words("kind", place.right + 6, y + 13, place.after)


def _span(at: RunAt, task: TaskAt) -> tuple[float, float]:
    """Return the start and the end of a task. If it has not ended, the end is now."""
    reached = task.reached.values()
    end = max(reached, default=0.0) if task.state in OVER else at.time
    return min(reached, default=at.time), end


def _notes(at: RunAt, task: TaskAt, with_data: bool) -> Iterator[str]:
    note = words.with_state(at, task, words.note_of(at, task))
    yield from words.lines_of(note, _NOTE_COLUMNS, _NOTE_LINES)
    if with_data and (data := words.data(task)):
        yield from wrap(cut(data, _LONGEST_DATA), _NOTE_COLUMNS)


def _lines(rows: list[Row], found: Arrows) -> list[Line]:
    """Return the lines between siblings."""
    numbers = {int(row.task.id): row.number for row in rows if row.task}
    families: dict[int, list[tuple[int, int]]] = {}
    for (first, second), kinds in found.between.items():
        one, other = numbers[first], numbers[second]
        if SEQ in kinds and one < other and rows[one].parent == rows[other].parent:
            families.setdefault(rows[one].parent, []).append((one, other))
    return [line for pairs in families.values() for line in lines(pairs)]


def _path(x: float, left: float, starts: list[float], ends: list[float]) -> str:
    """Return the path from boxes to a lane, down, and to boxes.

    Its turns are round, to differ from crossings.
    """
    turn = x + _ROUND
    parts = [
        f"M{left + 1:.1f} {y:.1f} H{turn:.1f} Q{x:.1f} {y:.1f} {x:.1f} {y + _ROUND:.1f}"
        for y in starts
    ]
    parts.append(f"M{x:.1f} {starts[0] + _ROUND:.1f} V{ends[-1] - _ROUND:.1f}")
    parts += [
        f"M{x:.1f} {y - _ROUND:.1f} Q{x:.1f} {y:.1f} {turn:.1f} {y:.1f} H{left - 5:.1f}"
        for y in ends
    ]
    return " ".join(parts)
