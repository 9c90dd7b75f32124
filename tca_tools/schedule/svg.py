"""Schedules as a picture, as figure 7 of the paper on preview coordination has them."""

from collections.abc import Iterator, Sequence
from textwrap import wrap

from tca_tools.drawing.svg import document, rectangle, text, width_of
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.chart import MEANINGS, Bar
from tca_tools.gantt.legend import HATCHING
from tca_tools.gantt.looks import AHEAD
from tca_tools.schedule.build import CURRENT, AgentRow, AgentSchedule
from tca_wire.coordination import TaskRole
from tca_wire.text.measures import duration, percent

_MARGIN, _PLOT, _LANE, _BLOCK, _TITLE = 24.0, 1000.0, 28.0, 18.0, 22.0
_BOX = _LANE - 4
_PLAIN = "#e4e7eb"
_TENTHS = 10
_NOTE = 150
"""Characters in a line below the rows."""
_STYLE = f"""\
.block {{ font-weight: bold; }} .label {{ text-anchor: end; }}
.gap {{ text-anchor: middle; fill: #7b8794; }} .words {{ text-anchor: middle; }}
.box {{ fill: {_PLAIN}; }} .ahead {{ fill: {AHEAD}; }} .wasted {{ fill: url(#wasted); }}
.frame {{ fill: none; stroke: #1f2933; }} .space {{ fill: #ffffff; stroke: #c5cbd3; }}
.axis {{ stroke: #1f2933; }}
.halo {{ stroke: #ffffff; stroke-width: 3px; stroke-linejoin: round; paint-order: stroke; }}"""


def svg_text(some: Sequence[AgentSchedule]) -> str:
    """The whole picture, as a document of its own."""
    longest = max(one.seconds for one in some)
    left = _MARGIN + 12 + max(width_of(row.agent) for one in some for row in one.rows)
    scale = Scale(_PLOT, 0.0, longest)
    body, y = list(_legend()), _MARGIN + 24
    for one in some:
        share = f"{duration(one.seconds)}, {percent(one.seconds / longest)}"
        body.append(f'<text class="block" x="{left:.1f}" y="{y + 13:.1f}">{text(f"{one.title}: {share}")}</text>')
        y += _TITLE
        for row in one.rows:
            body.append(f'<text class="label" x="{left - 8:.1f}" y="{y + 16:.1f}">{text(row.agent)}</text>')
            body += _row(row, scale, left, y)
            y += _LANE * max([1, *(box.lane + 1 for box in row.boxes)])
        for line in [line for note in one.notes for line in wrap(note, _NOTE)]:
            body.append(f'<text class="faint" x="{left:.1f}" y="{y + 12:.1f}">{text(line)}</text>')
            y += _BLOCK
        y += _BLOCK
    body += _axis(scale, left, y - _BLOCK + 2)
    title = ", ".join(one.title for one in some)
    return document(left + _PLOT + _MARGIN * 2, y + _MARGIN + 12, title, _STYLE, [f"<defs>{HATCHING}</defs>", *body])


def _legend() -> Iterator[str]:
    x = _MARGIN
    items = (("box", CURRENT), ("ahead", MEANINGS[TaskRole.AHEAD]), ("wasted", MEANINGS[TaskRole.WASTED]))
    for look, words in (*items, ("space", "w: waiting")):
        yield rectangle(f'class="{look}"', x, _MARGIN - 8, x + 16, 12)
        yield rectangle('class="frame"', x, _MARGIN - 8, x + 16, 12)
        yield f'<text x="{x + 22:.1f}" y="{_MARGIN + 2:.1f}">{text(words)}</text>'
        x += width_of(words) + 46


def _row(row: AgentRow, scale: Scale, left: float, y: float) -> Iterator[str]:
    for start, end in row.gaps:
        begin, until = left + scale.x(start), left + scale.x(end)
        yield rectangle('class="space"', begin, y, until, _BOX, f"waits {duration(end - start)}")
        if until - begin > width_of("w"):
            yield f'<text class="gap" x="{(begin + until) / 2:.1f}" y="{y + 16:.1f}" pointer-events="none">w</text>'
    for box in row.boxes:
        yield from _box(box, scale, left, y + box.lane * _LANE)


def _box(box: Bar, scale: Scale, left: float, y: float) -> Iterator[str]:
    begin = left + scale.x(box.start)
    end = max(left + scale.x(box.end), begin + 2)
    yield rectangle('class="box"', begin, y, end, _BOX)
    if box.ahead:
        yield rectangle(f'class="{box.preview}"', begin, y, max(left + scale.x(box.ahead[1]), begin + 2), _BOX)
    yield rectangle('class="frame" pointer-events="all"', begin, y, end, _BOX, box.title())
    words = next((one for one in box.labels if width_of(one) < end - begin), "")
    x, look = (begin + end) / 2, "words halo" if box.is_wasted else "words"
    if words:
        yield f'<text class="{look}" x="{x:.1f}" y="{y + 16:.1f}" pointer-events="none">{text(words)}</text>'


def _axis(scale: Scale, left: float, y: float) -> Iterator[str]:
    yield f'<line class="axis" x1="{left:.1f}" y1="{y:.1f}" x2="{left + scale.width:.1f}" y2="{y:.1f}"/>'
    for tenth in range(_TENTHS + 1):
        x, time = left + scale.width * tenth / _TENTHS, scale.end * tenth / _TENTHS
        yield f'<line class="axis" x1="{x:.1f}" y1="{y:.1f}" x2="{x:.1f}" y2="{y + 4:.1f}"/>'
        yield f'<text class="tick" x="{x:.1f}" y="{y + 17:.1f}">{tenth / _TENTHS:.0%}</text>'
        yield f'<text class="faint tick" x="{x:.1f}" y="{y + 30:.1f}">{duration(time)}</text>'
