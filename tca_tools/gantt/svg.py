"""A chart as SVG: dark bars where a handler runs, light where it waits, hatched below where messages queue."""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from statistics import median

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.bars import Bar, Chart, Row
from tca_tools.gantt.colours import dark, light
from tca_tools.terminal import columns_of, cut, printable

_NARROWEST, _WIDEST = 1100.0, 2200.0
_USUAL_BAR = 8.0
"""The chart is made wide enough for half of the bars to be that wide, within the limits above."""
_LANE, _QUEUE_LANE, _ROW_GAP, _MARGIN = 24.0, 9.0, 14.0, 24.0
_MOST_LANES = 12
_TITLE, _LEGEND_LINE, _AXIS = 34.0, 24.0, 26.0
_TICK_DISTANCE = 90.0
_CHARACTER = 6.5
"""Mean width of a character of the labels; a guess that must not be too small."""
_LONGEST_LABEL = 40
_SMALLEST = 0.8
"""What is narrower and hidden by its neighbour is not drawn: a chart of a million bars stays small."""
_STYLE = """\
text { font: 12px Helvetica, Arial, sans-serif; fill: #1f2933; }
.title { font-size: 15px; font-weight: bold; } .faint { fill: #52606d; font-size: 11px; }
.on { fill: #ffffff; font-size: 11px; } .grid { stroke: #d9dee4; } .connected { fill: #f1f3f5; }
.failed { fill: none; stroke: #c81e1e; stroke-width: 2; } .label { text-anchor: end; }"""


@dataclass(frozen=True)
class _Scale:
    """Where a time stands in the picture."""

    left: float
    width: float
    start: float
    end: float

    def x(self, time: float) -> float:
        time = min(max(time, self.start), self.end)
        span = self.end - self.start
        return self.left + (self.width * (time - self.start) / span if span > 0 else 0.0)


def svg_text(chart: Chart, title: str) -> str:
    """The whole picture, as a document of its own."""
    label_width = max((columns_of(_row_label(row)) for row in chart.rows), default=0) * _CHARACTER + 12
    scale = _Scale(_MARGIN + label_width, _plot_width(chart), chart.start, chart.end)
    width = scale.left + scale.width + _MARGIN
    legend, top = _legend(chart, width)
    bands: list[str] = []
    bars: list[str] = []
    bottom = top + _AXIS
    for row in chart.rows:
        bands += _band(row, scale, bottom)
        bars += _bars(row, chart, scale, bottom)
        bottom += _height(row) + _ROW_GAP
    height = bottom + _MARGIN / 2
    size = f'width="{width:.0f}" height="{height:.0f}"'
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {width:.0f} {height:.0f}">',
            f"<title>{_text(title)}</title>",
            f"<style>{_STYLE}</style>",
            *_patterns(chart),
            f'<rect {size} fill="#ffffff"/>',
            f'<text class="title" x="{_MARGIN:.0f}" y="{_MARGIN + 6:.0f}">{_text(title)}</text>',
            *legend,
            *bands,
            *_grid(scale, top + _AXIS, bottom),
            *bars,
            "</svg>\n",
        ]
    )


def _plot_width(chart: Chart) -> float:
    lengths = [bar.end - bar.start for row in chart.rows for bar in row.handled if bar.end > bar.start]
    if not lengths:
        return _NARROWEST
    wanted = _USUAL_BAR * (chart.end - chart.start) / median(lengths)
    return min(max(wanted, _NARROWEST), _WIDEST)


# --- rows ----------------------------------------------------------------------------------------------------------


def _height(row: Row) -> float:
    return min(row.lanes, _MOST_LANES) * _LANE + min(row.queue_lanes, _MOST_LANES) * _QUEUE_LANE


def _band(row: Row, scale: _Scale, top: float) -> Iterator[str]:
    """The row's name, and when its module was connected."""
    y = top + min(_LANE, _height(row)) / 2 + 4
    yield f'<text class="label" x="{scale.left - 10:.1f}" y="{y:.1f}">{_text(_row_label(row))}</text>'
    for start, end in row.connected:
        if end >= scale.start and start <= scale.end:
            yield _rectangle('class="connected"', scale.x(start), top - 3, scale.x(end), _height(row) + 6)


def _bars(row: Row, chart: Chart, scale: _Scale, top: float) -> Iterator[str]:
    numbers = {name: number for number, name in enumerate(chart.names)}
    for bar in _drawn(row.handled, scale):
        yield from _handled(bar, numbers[bar.name], scale, top + min(bar.lane, _MOST_LANES - 1) * _LANE)
    below = top + min(row.lanes, _MOST_LANES) * _LANE
    for bar in _drawn(row.queued, scale):
        y = below + min(bar.lane, _MOST_LANES - 1) * _QUEUE_LANE
        look = f'fill="url(#queued{numbers[bar.name]})" stroke="{dark(numbers[bar.name])}" stroke-width="0.6"'
        yield _rectangle(look, scale.x(bar.start), y + 1, scale.x(bar.end), _QUEUE_LANE - 2, bar.title)


def _drawn(bars: list[Bar], scale: _Scale) -> Iterator[Bar]:
    """The bars without those too narrow to be seen beside the one before."""
    reached: dict[int, float] = {}
    for bar in bars:
        right = max(scale.x(bar.end), scale.x(bar.start) + 1)
        if right > reached.get(bar.lane, -1.0) + _SMALLEST or bar.has_failed:
            reached[bar.lane] = right
            yield bar


def _handled(bar: Bar, number: int, scale: _Scale, top: float) -> Iterator[str]:
    left, right = scale.x(bar.start), scale.x(bar.end)
    y, height = top + 2, _LANE - 4
    gap = 0.8 if right - left > 4 and not bar.is_open else 0.0  # so that neighbours can be told apart
    yield _rectangle(f'fill="{dark(number)}"', left, y, right - gap, height, bar.title)
    waits = [(max(scale.x(wait.start), left), min(scale.x(wait.end), right), wait.title) for wait in bar.waits]
    for start, end, title in waits:
        if end - start > _SMALLEST:
            yield _rectangle(
                f'fill="{light(number)}" stroke="{dark(number)}" stroke-width="0.6"', start, y, end, height, title
            )
    if bar.is_open and bar.end <= scale.end:
        colour = light(number) if waits and waits[-1][1] >= right else dark(number)
        yield f'<path fill="{colour}" d="M{right:.1f} {y:.1f} l7 {height / 2:.1f} l-7 {height / 2:.1f} z"/>'
    if bar.has_failed:
        yield _rectangle('class="failed"', left, y, right, height)
    yield from _bar_label(bar.name, left, right, [(start, end) for start, end, _ in waits], y + height / 2 + 4)


def _bar_label(name: str, left: float, right: float, waits: list[tuple[float, float]], y: float) -> Iterator[str]:
    """The name, in the widest part of the bar, if it has room there."""
    edges = [left, *(edge for wait in sorted(waits) for edge in wait), right]
    parts = [(edges[i + 1] - edges[i], edges[i], i % 2) for i in range(len(edges) - 1)]
    width, start, is_light = max(parts)
    if width > columns_of(name) * _CHARACTER + 6:
        kind = "" if is_light else ' class="on"'
        yield f'<text{kind} x="{start + 4:.1f}" y="{y:.1f}" pointer-events="none">{_text(name)}</text>'


# --- what stands around them ---------------------------------------------------------------------------------------


def _patterns(chart: Chart) -> Iterator[str]:
    queued = {bar.name for row in chart.rows for bar in row.queued}
    yield "<defs>"
    for number, name in enumerate(chart.names):
        if name in queued:
            yield _pattern(f"queued{number}", dark(number))
    yield _pattern("queued", "#52606d") + "</defs>"


def _pattern(name: str, colour: str) -> str:
    return (
        f'<pattern id="{name}" width="5" height="5" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
        f'<rect width="5" height="5" fill="#ffffff"/><rect width="2" height="5" fill="{colour}"/></pattern>'
    )


def _grid(scale: _Scale, top: float, bottom: float) -> Iterator[str]:
    for time, label in ticks(scale.start, scale.end, int(scale.width / _TICK_DISTANCE)):
        x = scale.x(time)
        yield f'<line class="grid" x1="{x:.1f}" y1="{top - 8:.1f}" x2="{x:.1f}" y2="{bottom - 6:.1f}"/>'
        yield f'<text class="faint" text-anchor="middle" x="{x:.1f}" y="{top - 12:.1f}">{label}</text>'


def _legend(chart: Chart, width: float) -> tuple[list[str], float]:
    """Squares with their meanings, in as many lines as they need; and where what follows may begin."""
    shown = {bar.name for row in chart.rows for bar in (*row.handled, *row.queued)}
    items = [("#3e4c59", "handling"), ("#c5cbd3", "waiting for a reply or task"), ("url(#queued)", "queued")]
    items += [
        (dark(number), cut(printable(name), _LONGEST_LABEL)) for number, name in enumerate(chart.names) if name in shown
    ]
    lines: list[str] = []
    x, y = _MARGIN, _MARGIN + _TITLE - 12
    for fill, words in items:
        needed = columns_of(words) * _CHARACTER + 36
        if x + needed > width and x > _MARGIN:
            x, y = _MARGIN, y + _LEGEND_LINE
        lines.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="14" height="12" fill="{fill}"/>')
        lines.append(f'<text x="{x + 20:.1f}" y="{y + 10:.1f}">{escape(words)}</text>')
        x += needed
    return lines, y + _LEGEND_LINE + 6


def _rectangle(look: str, left: float, top: float, right: float, height: float, title: str = "") -> str:
    place = f'x="{left:.2f}" y="{top:.1f}" width="{max(right - left, 1.0):.2f}" height="{height:.1f}"'
    return f"<rect {look} {place}><title>{_text(title)}</title></rect>" if title else f"<rect {look} {place}/>"


def _row_label(row: Row) -> str:
    return cut(printable(row.label), _LONGEST_LABEL)


def _text(text: str) -> str:
    return escape(printable(text))
