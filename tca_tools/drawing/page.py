"""A picture as an HTML page: one file, titles on hover, zoom with the wheel, pan by dragging.

Zooming a chart changes its width only, and keeps its labels and the names of bars in view. Any
other picture is scaled as a whole.
"""

import re
from html import escape
from pathlib import Path

_HERE = Path(__file__).parent


def zoomed_page(title: str, svg: str) -> str:
    """Return a page with one picture; *svg* is a document that starts with ``<svg ``."""
    start = svg.index("<svg ") + len("<svg ")
    in_pixels = re.sub(r'((?:width|height)="[0-9.]+)pt"', r'\1"', svg[start:], count=2)
    return _page(title, f'<main><svg class="zoomed" {in_pixels}</main>')


def wide_page(title: str, head: str, labels: str, plot: str) -> str:
    """Return a page with a chart.

    Args:
        title: The title of the page.
        head: The part above the chart.
        labels: The labels at the left, which are not zoomed.
        plot: The plot (``<svg ...>``), whose width is zoomed.
    """
    inner = plot.replace("<svg ", '<svg class="zoomed wide" preserveAspectRatio="none" ', 1)
    return _page(
        title, f'<header>{head}</header>\n<main><div id="fixed">{labels}</div>{inner}</main>'
    )


def _page(title: str, body: str) -> str:
    frame, style, script = (
        (_HERE / name).read_text() for name in ("page.html", "zoom.css", "zoom.js")
    )
    return frame.format(title=escape(title), style=style, body=body, script=script)
