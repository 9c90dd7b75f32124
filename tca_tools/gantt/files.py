"""A chart as a file: a picture, a page or text, as its name asks for."""

from pathlib import Path

import click

from tca_tools.drawing.page import wide_page
from tca_tools.drawing.pictures import converted
from tca_tools.gantt.parts import Chart
from tca_tools.gantt.shapes import MARGIN, STYLE
from tca_tools.gantt.svg import pieces_of, svg_text
from tca_tools.gantt.text import Blocks, chart_lines
from tca_tools.output import write_output

KINDS = (".svg", ".png", ".pdf", ".html", ".txt")
WIDTH_OF_TEXT = 120
_PAGE = 1000.0
"""Pixels: of a page's plot that it is made wider from; what has room there has it in most windows."""


def write_chart(output: Path, chart: Chart, title: str, blocks: Blocks) -> None:
    """Write the kind of file that its name asks for. Raises ToolError if that can't be done."""
    kind = output.suffix
    if kind == ".txt":
        lines = [title, *chart_lines(chart, WIDTH_OF_TEXT, blocks)]
        write_output(output, click.unstyle("\n".join(lines)) + "\n")
    elif kind == ".html":
        write_output(output, page_text(chart, title))
    else:
        svg = svg_text(chart, title)
        write_output(output, svg if kind == ".svg" else converted(svg, kind[1:]))


def page_text(chart: Chart, title: str) -> str:
    """The chart as a page that can be zoomed."""
    pieces = pieces_of(chart, title, can_zoom=True, widest=_PAGE)
    left = MARGIN + pieces.label_width
    head = _svg(pieces.head_width, pieces.head_height, f"<style>{STYLE}</style>{pieces.head}")
    labels = _svg(left, pieces.height, f'<g transform="translate({MARGIN:.0f} 0)">{pieces.labels}</g>')
    return wide_page(title, head, labels, _svg(pieces.plot_width, pieces.height, pieces.plot))


def _svg(width: float, height: float, inner: str) -> str:
    size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{inner}</svg>'
