"""A wide tree as an SVG picture: one line a task, with guides, what it waits for, and bars of its times."""

from collections.abc import Iterator
from operator import itemgetter

from tca_tools.coping import STANDINGS
from tca_tools.drawing import document, rectangle, text
from tca_tools.gantt.axis import ticks
from tca_tools.records import State
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import MEANINGS, SEQ, arrows
from tca_tools.tasktree_viz.dot import FILLS, looks_of
from tca_tools.tasktree_viz.outline import Row
from tca_tools.tasktree_viz.plan import BOX, CHARACTER, LINE, Place, Plan, plan
from tca_tools.then import TaskThen, Then

_MARGIN, _GAP = 24.0, 18.0
_TIMES = 460.0
_BETWEEN = 13.0
"""Room between two meanings in a line."""
_TICK_DISTANCE = 80.0
_STYLE = """\
.name { font-size: 12px; } .note { font-size: 10.5px; fill: #52606d; } .id { fill: #52606d; }
.guide { stroke: #b8c0ca; fill: none; } .heavy { stroke: #0b4f8a; stroke-width: 2.6; fill: none; }
.kind { font-size: 10.5px; fill: #0b4f8a; } .tip { fill: #0b4f8a; } .zebra { fill: #f7f8fa; }
.planning { fill: #b9a6e8; } .outlined { stroke: #1f2933; }"""
_SECOND = "planning"
_FOLDED = (
    "so many tasks folded up; a part of the tree (--task, --module, --from, --to), or a .txt with --all, shows them"
)


def outline_svg(then: Then, rows: list[Row], title: str, *, with_data: bool = False) -> str:
    """The whole picture, as a document of its own."""
    found = arrows(then, {row.task.id for row in rows if row.task})
    laid = plan(then, rows, found, with_data=with_data)
    columns = _Columns(laid, then)
    head, top = _head(rows, title, bool(laid.before), found.kinds, columns.right)
    body = [*head, *columns.axis(top, top + 22 + laid.height)]
    top += 26
    for place in laid.places:
        body += columns.line(place, top)
    body += _guides(laid, top)
    for place in laid.places:
        body += _box(then, place, top)
    return document(columns.right + _MARGIN, top + laid.height + _MARGIN, title, _STYLE, body)


class _Columns:
    """What stands beside the boxes: state, notes, and bars on an axis of time."""

    def __init__(self, laid: Plan, then: Then) -> None:
        tasks = [place.row.task for place in laid.places if place.row.task]
        self.start = min((min(task.reached.values(), default=then.time) for task in tasks), default=0.0)
        self.end = max((_last(task, then.time) for task in tasks), default=then.time)
        self.notes = _MARGIN + laid.width + _GAP
        self.times = self.notes + laid.notes_width + _GAP
        self.right = self.times + _TIMES

    def x(self, time: float) -> float:
        """Where a time stands."""
        span = self.end - self.start
        return self.times + (_TIMES * (min(max(time, self.start), self.end) - self.start) / span if span > 0 else 0.0)

    def axis(self, top: float, bottom: float) -> Iterator[str]:
        """The axis above, and lines down from it."""
        for time, label in ticks(self.start, self.end, int(_TIMES / _TICK_DISTANCE)):
            x = self.x(time)
            yield f'<line class="grid" x1="{x:.1f}" y1="{top + 14:.1f}" x2="{x:.1f}" y2="{bottom:.1f}"/>'
            yield f'<text class="faint tick" x="{x:.1f}" y="{top + 9:.1f}">{label}</text>'

    def line(self, place: Place, top: float) -> Iterator[str]:
        """State, notes and bars of one task."""
        task, y = place.row.task, top + place.top
        if task is None:
            return
        for number, note in enumerate(place.notes):
            yield f'<text class="note" x="{self.notes:.1f}" y="{y + 13 + number * LINE:.1f}">{text(note)}</text>'
        for kind, span in ((_SECOND, place.planning), ("achieving", place.achieving)):
            if span:
                yield self._bar(task, kind, span, y)

    def _bar(self, task: TaskThen, kind: str, span: tuple[float, float | None], y: float) -> str:
        start, end = span
        left, right = self.x(start), self.x(self.end if end is None else end)
        title = f"{task}: {kind} from {start:.3f} s" + (" on" if end is None else f" to {end:.3f} s")
        right = max(right, left + 1.5)
        if kind == _SECOND:
            return rectangle('class="planning"', left, y + 1, right, 5, title)
        return rectangle(
            f'fill="{FILLS[task.standing]}" stroke="#52606d" stroke-width="0.7"', left, y + 6, right, 10, title
        )


def _last(task: TaskThen, now: float) -> float:
    is_over = task.state in (State.ACHIEVED, State.FAILED, State.KILLED)
    return max(task.reached.values(), default=0.0) if is_over else now


def _guides(laid: Plan, top: float) -> Iterator[str]:
    """Thin lines from a task to what is under it; heavy ones, over them, to who comes after a brother."""
    for place in laid.places:
        if place.row.parent >= 0:
            start = top + laid.places[place.row.parent].top + BOX
            y, left = top + place.top + BOX / 2, _MARGIN + place.left
            yield f'<path class="guide" d="M{left - laid.indent / 2:.1f} {start:.1f} V{y:.1f} H{left:.1f}"/>'
    for number, before in laid.before.items():
        place, brother = laid.places[number], laid.places[before]
        tip, rail = _MARGIN + place.left, _MARGIN + place.left - laid.indent / 2
        start, y = (top + one.top + BOX / 2 for one in (brother, place))
        yield f'<path class="heavy" d="M{tip:.1f} {start:.1f} H{rail:.1f} V{y:.1f} H{tip - 5:.1f}"/>'
        yield f'<path class="tip" d="M{tip:.1f} {y:.1f} l-8 -4 v8 z"/>'


def _box(then: Then, place: Place, top: float) -> Iterator[str]:
    row, task, left, y = place.row, place.row.task, _MARGIN + place.left, top + place.top
    look = f'fill="{FILLS[row.state if task is None else task.standing]}" stroke="#1f2933"'
    title = place.label
    if task is None:
        look += ' stroke-dasharray="3 2"'
    else:
        look += ' rx="7"' if task.message_class.is_goal else ""
        look += ' stroke-dasharray="4 3"' if task.state is State.HELD else ""
        if looks := looks_of(task):
            look = look.replace('stroke="#1f2933"', f'stroke="{looks[0]}" stroke-width="2.2"')
        title = "\n".join(
            filter(None, [f"{words.called(task)}: {task.standing}", words.note(then, task), words.data(task)])
        )
    yield rectangle(look, left, y, left + place.width, BOX, title)
    yield f'<text class="name" x="{left + 7:.1f}" y="{y + 13.5:.1f}" pointer-events="none">{text(place.label)}</text>'
    if place.after:
        x = left + place.width + 6
        yield f'<text class="kind" x="{x:.1f}" y="{y + 13:.1f}">{text(place.after)}</text>'


def _head(rows: list[Row], title: str, has_heavy: bool, kinds: set[str], right: float) -> tuple[list[str], float]:
    """The title, what colours and lines mean (nothing of that beyond *right*), and where what follows may begin."""
    lines = [f'<text class="title" x="{_MARGIN:.0f}" y="{_MARGIN + 6:.0f}">{text(title)}</text>']
    states = {row.task.standing if row.task else row.state for row in rows}
    items = [(f'fill="{FILLS[state]}" stroke="#52606d"', str(state)) for state in STANDINGS if state in states]
    items.append(('class="planning"', "when it was planned"))
    borders = {looks for row in rows if row.task and (looks := looks_of(row.task))}
    items += [
        (f'fill="#ffffff" stroke="{colour}" stroke-width="2.2"', meaning)
        for colour, meaning in sorted(borders, key=itemgetter(1))
    ]
    x, y = _MARGIN, _MARGIN + 20
    for look, words_of in items:
        needed = len(words_of) * CHARACTER + 34
        if x + needed - _BETWEEN > right and x > _MARGIN:
            x, y = _MARGIN, y + 20
        lines.append(rectangle(look, x, y, x + 16, 12))
        lines.append(f'<text class="name" x="{x + 21:.1f}" y="{y + 10:.1f}">{words_of}</text>')
        x += needed
    y += 32
    meanings = [("heavy lines", MEANINGS[SEQ])] * has_heavy
    meanings += [("dashed, with +", _FOLDED)] * any(row.folded for row in rows)
    meanings += [(kind, meaning) for kind, meaning in MEANINGS.items() if kind in kinds and kind != SEQ]
    for what, meaning in meanings:
        lines.append(f'<text class="kind" x="{_MARGIN:.0f}" y="{y:.1f}">{what}: {meaning}</text>')
        y += LINE
    return lines, y + 4
