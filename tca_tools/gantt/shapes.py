"""The small things that a chart's SVG is made of: rectangles, texts, and their common look."""

from html import escape

from tca_tools.gantt.bars import Row
from tca_tools.terminal import cut, printable

MARGIN = 24.0
CHARACTER = 6.5
"""Mean width of a character of the labels; a guess that must not be too small."""
LONGEST_LABEL = 40
STYLE = """\
text { font: 12px Helvetica, Arial, "Liberation Sans", sans-serif; fill: #1f2933; }
.title { font-size: 15px; font-weight: bold; } .faint { fill: #52606d; font-size: 11px; } .tick { text-anchor: middle; }
.on { fill: #ffffff; font-size: 11px; } .grid { stroke: #d9dee4; } .connected { fill: #f1f3f5; }
.failed { fill: none; stroke: #c81e1e; stroke-width: 2; } .label { text-anchor: end; } .beside { opacity: 0.4; }
.locked { fill: #f6c9c5; } .reserved { fill: #f9e3b4; } .in { font-size: 11px; }"""


def rectangle(look: str, left: float, top: float, right: float, height: float, title: str = "") -> str:
    """A rectangle with its title; *right* may be no more than *left*, but it stays visible then."""
    place = f'x="{left:.2f}" y="{top:.1f}" width="{max(right - left, 0.05):.2f}" height="{height:.1f}"'
    return f"<rect {look} {place}><title>{text(title)}</title></rect>" if title else f"<rect {look} {place}/>"


def row_label(row: Row) -> str:
    """The row's name as it is shown."""
    return cut(printable(row.label), LONGEST_LABEL)


def text(words: str) -> str:
    """*words* as SVG takes them."""
    return escape(printable(words))
