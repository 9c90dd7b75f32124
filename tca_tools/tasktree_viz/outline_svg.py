"""A wide tree as an SVG picture: one line a task, with guides, what it waits for, and bars of its times."""

from collections import Counter
from collections.abc import Iterator
from operator import attrgetter

from tca_tools.drawing.svg import document, rectangle, text
from tca_tools.gantt.axis import ticks
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import STANDINGS
from tca_tools.journal.records import OVER, TaskState
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import MEANINGS, SEQ, arrows
from tca_tools.tasktree_viz.dot import FILLS, borders, looks_of
from tca_tools.tasktree_viz.outline import Row
from tca_tools.tasktree_viz.plan import BOX, CHARACTER, LANE, LINE, Placement, Plan, plan

_MARGIN, _GAP = 24.0, 18.0
_TIMES = 460.0
_BETWEEN = 13.0
"""Room between two meanings in a line."""
_TICK_DISTANCE = 80.0
_COMES, _ROUND = 4.5, 4.0
"""Pixels from the top of a box to where a line comes to it, and of a turn."""
_STYLE = """\
.name { font-size: 12px; } .note { font-size: 10.5px; fill: #52606d; } .id { fill: #52606d; }
.guide { stroke: #b8c0ca; fill: none; } .heavy { stroke: #0b4f8a; stroke-width: 2.2; fill: none; }
.over { stroke: #ffffff; stroke-width: 5.2; fill: none; }
.kind { font-size: 10.5px; fill: #0b4f8a; } .tip { fill: #0b4f8a; } .zebra { fill: #f7f8fa; }
.planning { fill: #b9a6e8; } .outlined { stroke: #1f2933; }"""
_JOINED = "; one that begins at several tasks: all of them before all that it leads to"


def outline_svg(at: RunAt, rows: list[Row], title: str, *, with_data: bool = False) -> str:
    """The whole picture, as a document of its own."""
    found = arrows(at, {row.task.id for row in rows if row.task})
    laid = plan(at, rows, found, with_data=with_data)
    columns = _Columns(laid, at)
    head, top = _head(rows, title, laid, found.kinds, columns.right)
    body = [*head, *columns.axis(top, top + 22 + laid.height)]
    top += 26
    for place in laid.places:
        body += columns.line(place, top)
    body += [*_guides(laid, top), *_heavy(laid, top)]
    for place in laid.places:
        body += _box(at, place, top)
    return document(columns.right + _MARGIN, top + laid.height + _MARGIN, title, _STYLE, body)


class _Columns:
    """The columns beside the boxes: state, notes, and bars on an axis of time."""

    def __init__(self, laid: Plan, at: RunAt) -> None:
        tasks = [place.row.task for place in laid.places if place.row.task]
        self.start = min((min(task.reached.values(), default=at.time) for task in tasks), default=0.0)
        ends = (max(task.reached.values(), default=0.0) if task.state in OVER else at.time for task in tasks)
        self.end = max(ends, default=at.time)
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

    def line(self, place: Placement, top: float) -> Iterator[str]:
        """State, notes and bars of one task."""
        task, y = place.row.task, top + place.top
        if task is None:
            return
        for number, note in enumerate(place.notes):
            yield f'<text class="note" x="{self.notes:.1f}" y="{y + 13 + number * LINE:.1f}">{text(note)}</text>'
        achieving = f'fill="{FILLS[task.standing]}" stroke="#52606d" stroke-width="0.7"'
        for kind, span, look, below, height in (
            ("planning", place.planning, 'class="planning"', 1, 5),
            ("achieving", place.achieving, achieving, 6, 10),
        ):
            if span:
                start, end = span
                left, right = self.x(start), self.x(self.end if end is None else end)
                title = f"{task}: {kind} from {start:.3f} s" + (" on" if end is None else f" to {end:.3f} s")
                yield rectangle(look, left, y + below, max(right, left + 1.5), height, title)


def _guides(laid: Plan, top: float) -> Iterator[str]:
    """Thin lines from a task to what is under it."""
    for place in laid.places:
        if place.row.parent >= 0:
            above = laid.places[place.row.parent]
            x, y = _MARGIN + above.left + laid.indent / 2, top + place.top + BOX / 2
            yield f'<path class="guide" d="M{x:.1f} {top + above.top + BOX:.1f} V{y:.1f} H{_MARGIN + place.left:.1f}"/>'


def _heavy(laid: Plan, top: float) -> Iterator[str]:
    """Lines to those that come after their brothers: they leave boxes below where others come to them."""
    all_leaving = Counter(source for line in laid.lines for source in line.sources)
    leaving: Counter[int] = Counter()
    tips: list[str] = []
    for line in sorted(laid.lines, key=attrgetter("lane")):  # those further away cross the nearer, and lie over them
        leaving.update(line.sources)
        share = {source: 1 - leaving[source] / (all_leaving[source] + 1) for source in line.sources}
        starts = [top + laid.places[one].top + _COMES + (BOX - _COMES) * part for one, part in share.items()]
        ends = [top + laid.places[one].top + _COMES for one in line.to]
        left = _MARGIN + laid.places[line.to[0]].left
        x = left - laid.indent / 2 - line.lane * LANE
        if line.lane:  # it crosses those that are nearer: there they are cut
            across = " ".join(f"M{left:.1f} {y:.1f} H{x + _ROUND:.1f}" for y in (*starts, *ends))
            yield f'<path class="over" d="{across}"/>'
        yield f'<path class="heavy" d="{_path(x, left, starts, ends)}"/>'
        tips += [f'<path class="tip" d="M{left:.1f} {y:.1f} l-8 -4 v8 z"/>' for y in ends]
    yield from tips


def _path(x: float, left: float, starts: list[float], ends: list[float]) -> str:
    """From boxes to a lane, down, and to boxes; where it turns it is round, so that a turn is no crossing."""
    turn = x + _ROUND
    parts = [f"M{left + 1:.1f} {y:.1f} H{turn:.1f} Q{x:.1f} {y:.1f} {x:.1f} {y + _ROUND:.1f}" for y in starts]
    parts.append(f"M{x:.1f} {starts[0] + _ROUND:.1f} V{ends[-1] - _ROUND:.1f}")
    parts += [f"M{x:.1f} {y - _ROUND:.1f} Q{x:.1f} {y:.1f} {turn:.1f} {y:.1f} H{left - 5:.1f}" for y in ends]
    return " ".join(parts)


def _box(at: RunAt, place: Placement, top: float) -> Iterator[str]:
    row, task, left, y = place.row, place.row.task, _MARGIN + place.left, top + place.top
    if task is None:
        look = f'fill="{FILLS.get(row.state, "#ffffff")}" stroke="#1f2933" stroke-dasharray="3 2"'
    else:
        border = looks_of(task)
        stroke = f'stroke="{border[0]}" stroke-width="2.2"' if border else 'stroke="#1f2933"'
        look = f'fill="{FILLS[task.standing]}" {stroke}'
        look += ' rx="7"' if task.message_class.is_goal else ""
        look += ' stroke-dasharray="4 3"' if task.state is TaskState.HELD else ""
    title = words.tooltip(at, task) if task else place.label
    yield rectangle(look, left, y, left + place.width, BOX, title)
    yield f'<text class="name" x="{left + 7:.1f}" y="{y + 13.5:.1f}" pointer-events="none">{text(place.label)}</text>'
    if place.after:
        x = left + place.width + 6
        yield f'<text class="kind" x="{x:.1f}" y="{y + 13:.1f}">{text(place.after)}</text>'


def _head(rows: list[Row], title: str, laid: Plan, kinds: set[str], right: float) -> tuple[list[str], float]:
    """The title, what colours and lines mean (nothing of that beyond *right*), and where what follows may begin."""
    lines = [f'<text class="title" x="{_MARGIN:.0f}" y="{_MARGIN + 6:.0f}">{text(title)}</text>']
    states = {row.task.standing if row.task else row.state for row in rows}
    items = [(f'fill="{FILLS[state]}" stroke="#52606d"', str(state)) for state in STANDINGS if state in states]
    items.append(('class="planning"', "when it was planned"))
    items += [(f'fill="#ffffff" stroke="{colour}" stroke-width="2.2"', meaning) for colour, meaning in borders(rows)]
    x, y = _MARGIN, _MARGIN + 20
    for look, words_of in items:
        needed = len(words_of) * CHARACTER + 34
        if x + needed - _BETWEEN > right and x > _MARGIN:
            x, y = _MARGIN, y + 20
        lines.append(rectangle(look, x, y, x + 16, 12))
        lines.append(f'<text class="name" x="{x + 21:.1f}" y="{y + 10:.1f}">{words_of}</text>')
        x += needed
    y += 32
    joined = _JOINED if any(len(line.sources) > 1 for line in laid.lines) else ""
    after = " and ".join(["heavy lines"] * bool(laid.lines) + ['"after"'])
    meanings = [(after, MEANINGS[SEQ] + joined)] * (SEQ in kinds)
    meanings += [("dashed, with +", words.FOLDED_UP)] * any(row.folded for row in rows)
    meanings += [(kind, meaning) for kind, meaning in MEANINGS.items() if kind in kinds and kind != SEQ]
    for what, meaning in meanings:
        lines.append(f'<text class="kind" x="{_MARGIN:.0f}" y="{y:.1f}">{what}: {meaning}</text>')
        y += LINE
    return lines, y + 4
