"""Schedules as a picture, like figure 7 of the paper on preview coordination."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import wrap

from tca_tools.drawing.svg import UNTOUCHED, document, line, rectangle, width_of, words
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.chart import Bar, BarKind, Chart
from tca_tools.gantt.legend import HATCHINGS, legend
from tca_tools.gantt.looks import MARGIN
from tca_tools.schedule.build import LEGEND, heading
from tca_wire.coordination import TaskRole
from tca_wire.text.measures import duration

_PLOT, _LANE, _BLOCK, _TITLE = 1000.0, 28.0, 18.0, 22.0
_BOX = _LANE - 4
_TENTHS = 10
_NOTE = 150
"""The most characters in a line below the rows."""
_LOOKS: dict[str, str] = {
    BarKind.HANDLED: 'class="box"',
    TaskRole.AHEAD: 'class="ahead"',
    TaskRole.WASTED: 'class="wasted"',
    BarKind.IDLE: 'class="idle"',
}
_STYLE = Path(__file__).with_name("schedule.css").read_text()


def svg_text(charts: Sequence[Chart]) -> str:
    """Return the schedules as an SVG document."""
    longest = max(chart.end for chart in charts)
    left = MARGIN + 12 + max(width_of(row.label) for chart in charts for row in chart.rows)
    scale, width = Scale(_PLOT, 0.0, longest), left + _PLOT + MARGIN * 2
    items = [(_LOOKS[kind], meaning) for kind, meaning in LEGEND.items()]
    body, y = legend(items, width, MARGIN - 8)
    for chart in charts:
        y += _BLOCK
        body.append(words("block", left, y, heading(chart, longest)))
        y += _TITLE - 13
        for row in chart.rows:
            body.append(words("label", left - 8, y + 16, row.label))
            for box in sorted(row.handled, key=_is_task):  # frames of tasks lie over those of gaps
                body += _box(box, scale, left, y + box.lane * _LANE)
            y += _LANE * row.lanes
        for part in [part for note in chart.notes for part in wrap(note, _NOTE)]:
            body.append(words("faint", left, y + 12, part))
            y += _BLOCK
        y += 13
    body += _axis(scale, left, y - 11)
    body.append(HATCHINGS)
    title = ", ".join(chart.title for chart in charts)
    return document(width, y + MARGIN + 12, title, _STYLE, body)


def _is_task(box: Bar) -> bool:
    return box.kind is not BarKind.IDLE


def _box(box: Bar, scale: Scale, left: float, y: float) -> Iterator[str]:
    begin = left + scale.x(box.start)
    end = max(left + scale.x(box.end), begin + 2)
    yield rectangle(_LOOKS[box.kind], begin, y, end, _BOX, box.title())
    if box.early_span:
        until = max(left + scale.x(box.early_span[1]), begin + 2)
        yield rectangle(_LOOKS[box.early_style] + UNTOUCHED, begin, y, until, _BOX)
    look = "words" + " halo" * box.is_wasted + " pale" * (not _is_task(box))
    for label in [one for one in box.labels if width_of(one) < end - begin][:1]:
        yield words(look, (begin + end) / 2, y + 16, label, UNTOUCHED)


def _axis(scale: Scale, left: float, y: float) -> Iterator[str]:
    yield line("axis", left, y, left + scale.width, y)
    for share in (tenth / _TENTHS for tenth in range(_TENTHS + 1)):
        x = left + scale.width * share
        yield line("axis", x, y, x, y + 4)
        yield words("tick", x, y + 17, f"{share:.0%}")
        yield words("faint tick", x, y + 30, duration(scale.end * share))
