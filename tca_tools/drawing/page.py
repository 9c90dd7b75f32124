"""A picture as a page of its own: one file, nothing fetched, hover titles, zoom with the wheel, pan
by dragging.

A chart is made wider only, with its labels in sight, and the names of bars that begin left of what
is seen; any other picture is made larger as a whole.
"""

import re
from html import escape
from pathlib import Path

_HERE = Path(__file__).parent


def zoomed_page(title: str, svg: str) -> str:
    """A page with one picture; *svg* is a document that begins with ``<svg ``."""
    start = svg.index("<svg ") + len("<svg ")
    in_pixels = re.sub(r'((?:width|height)="[0-9.]+)pt"', r'\1"', svg[start:], count=2)
    return _page(title, f'<main><svg class="zoomed" {in_pixels}</main>')


def wide_page(title: str, head: str, labels: str, plot: str) -> str:
    """A page with a chart: its head, and below it labels that stay and a plot (``<svg ...>``) that
    gets wider.
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
