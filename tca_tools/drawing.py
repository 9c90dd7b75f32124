"""The small things that our SVG pictures are made of: rectangles, texts, documents and their common look."""

from collections.abc import Iterable
from html import escape

from tca_tools.terminal import printable

STYLE = """\
text { font: 12px Helvetica, Arial, "Liberation Sans", sans-serif; fill: #1f2933; }
.title { font-size: 15px; font-weight: bold; } .faint { fill: #52606d; font-size: 11px; } .tick { text-anchor: middle; }
.grid { stroke: #d9dee4; }
"""


def document(width: float, height: float, title: str, style: str, body: Iterable[str]) -> str:
    """A whole picture."""
    size = f'width="{width:.0f}" height="{height:.0f}"'
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {width:.0f} {height:.0f}">',
            f"<title>{text(title)}</title>",
            f"<style>{STYLE}{style}</style>",
            f'<rect {size} fill="#ffffff"/>',
            *body,
            "</svg>\n",
        ]
    )


def rectangle(look: str, left: float, top: float, right: float, height: float, title: str = "") -> str:
    """A rectangle with its title; *right* may be no more than *left*, but it stays visible then."""
    place = f'x="{left:.2f}" y="{top:.1f}" width="{max(right - left, 0.05):.2f}" height="{height:.1f}"'
    return f"<rect {look} {place}><title>{lines(title)}</title></rect>" if title else f"<rect {look} {place}/>"


def text(words: str) -> str:
    """*words* as SVG takes them."""
    return escape(printable(words))


def lines(words: str) -> str:
    """The same of several lines."""
    return "\n".join(map(text, words.split("\n")))
