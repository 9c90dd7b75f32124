"""A chart as an SVG picture or page: a bar is dark while a handler runs, light while it waits.

Queued messages are hatched.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from statistics import median

from tca_tools.drawing.page import wide_page
from tca_tools.drawing.svg import document, line, rectangle, width_of, words
from tca_tools.gantt.axis import Scale, ticks
from tca_tools.gantt.chart import RESTART, Chart
from tca_tools.gantt.legend import HATCHINGS, legend, meanings, patterns
from tca_tools.gantt.looks import MARGIN, OWN_STYLE, STYLE, label_room
from tca_tools.gantt.rows import Painter

_NARROWEST, _WIDEST = 1100.0, 1700.0
_USUAL_BAR = 8.0
"""Within the limits above, the chart is so wide that half of the bars have at least this width."""
_ROW_GAP, _AXIS, _TITLE = 14.0, 26.0, 22.0
_TICK_DISTANCE = 90.0
_MOST_SHAPES = {1: inf, 4: 80_000, 16: 20_000}
"""By zoom: the most bars of a chart whose page contains the details for this zoom.

With more bars, these details would make the page too large for a browser.
"""
_WINDOW = 1200.0
"""A width that most windows have."""
_PAGE = 1000.0
"""Pixels: the width of a page's plot before zooming. Words that fit in it fit in most windows."""


@dataclass(frozen=True)
class Pieces:
    """The pieces of a chart, which a picture, page or report puts together."""

    meanings: list[tuple[str, str]]
    """The squares of its legend, with their meanings."""
    labels: str
    label_width: float
    plot: str
    plot_width: float
    height: float
    """The height of labels and plot, which stand side by side."""


def svg_text(chart: Chart, title: str) -> str:
    """Return the chart as an SVG document."""
    pieces = pieces_of(chart)
    left = MARGIN + pieces.label_width
    width = left + pieces.plot_width + MARGIN
    head, top = _head(pieces, title, width)
    body = [
        *head,
        f'<g transform="translate({MARGIN:.0f} {top:.1f})">{pieces.labels}</g>',
        f'<g transform="translate({left:.1f} {top:.1f})">{pieces.plot}</g>',
    ]
    return document(width, top + pieces.height + MARGIN / 2, title, OWN_STYLE, body)


def page_text(chart: Chart, title: str) -> str:
    """Return the chart as an HTML page that can be zoomed."""
    pieces = pieces_of(chart, can_zoom=True, widest=_PAGE)
    head, top = _head(pieces, title, _WINDOW)
    shifted = f'<g transform="translate({MARGIN:.0f} 0)">{pieces.labels}</g>'
    return wide_page(
        title,
        _svg(_WINDOW, top, "\n".join([f"<style>{STYLE}</style>", *head])),
        _svg(MARGIN + pieces.label_width, pieces.height, shifted),
        _svg(pieces.plot_width, pieces.height, pieces.plot),
    )


def _svg(width: float, height: float, inner: str) -> str:
    size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{inner}</svg>'


def pieces_of(chart: Chart, *, can_zoom: bool = False, widest: float = _WIDEST) -> Pieces:
    """Return the pieces of a chart.

    Args:
        chart: The chart.
        can_zoom: Whether to include the details that show only when the plot is zoomed.
        widest: The greatest width of the plot in pixels.
    """
    width = min(_plot_width(chart), widest)
    label_width = max((label_room(row) for row in chart.rows), default=0.0) + 12
    bar_count = sum(len(row.handled) + len(row.queued) for row in chart.rows)
    zooms = tuple(_MOST_SHAPES)[: None if can_zoom else 1]
    possible = [zoom for zoom in zooms if bar_count <= _MOST_SHAPES[zoom]]
    scale = Scale(width, chart.start, chart.end, tuple(possible))
    painter = Painter(chart, scale)
    labels: list[str] = []
    bands: list[str] = []
    bars: list[str] = []
    bottom = _AXIS
    for row in chart.rows:
        labels.append(painter.label(row, label_width - 10, bottom))
        bands += painter.band(row, bottom)
        bars += painter.bars(row, bottom)
        bottom += painter.height(row) + _ROW_GAP
    grid = list(_grid(scale, bottom, zooms))
    grid += [
        rectangle(f'class="{RESTART}"', x - 0.75, 18, x + 0.75, bottom - 24, str(one))
        for one in chart.restarts
        for x in (scale.x(one.time),)
    ]
    plot = "\n".join([patterns(chart), *bands, *grid, *bars])
    return Pieces(meanings(chart, scale), "\n".join(labels), label_width, plot, width, bottom)


def _plot_width(chart: Chart) -> float:
    handled = [bar for row in chart.rows for bar in row.handled]
    lengths = [bar.end - bar.start for bar in handled if bar.end > bar.start]
    if not lengths:
        return _NARROWEST
    wanted = _USUAL_BAR * (chart.end - chart.start) / median(lengths)
    return min(max(wanted, _NARROWEST), _WIDEST)


def _head(pieces: Pieces, title: str, width: float) -> tuple[list[str], float]:
    """Return the title and the legend, and the y below them."""
    squares, height = legend(pieces.meanings, width, MARGIN + _TITLE)
    return [HATCHINGS, words("title", MARGIN, MARGIN + 6, title), *squares], height


def _grid(scale: Scale, bottom: float, zooms: tuple[int, ...]) -> Iterator[str]:
    drawn: set[str] = set()
    for zoom in zooms:
        for time, label in ticks(scale.start, scale.end, int(scale.width * zoom / _TICK_DISTANCE)):
            if f"{time:.9g}" in drawn:
                continue  # the grid of a smaller zoom has it
            drawn.add(f"{time:.9g}")
            x, kind = scale.x(time), "" if zoom == 1 else f" z{zoom}"
            yield line(f"grid{kind}", x, 18, x, bottom - 6)
            yield words(f"faint tick{kind}{_side(label, x, scale)}", x, 13, label)


def _side(label: str, x: float, scale: Scale) -> str:
    """Return the style of a label that the edge of the plot would cut, even if it is zoomed."""
    room = width_of(label)
    if x < room:
        return " after"
    return " before" if x > scale.width - room else ""
