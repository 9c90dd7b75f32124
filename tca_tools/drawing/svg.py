"""The elements of SVG pictures: rectangles, lines, texts, documents, and their common style."""

from collections.abc import Iterable
from html import escape
from pathlib import Path

from tca_tools.terminal import columns_of
from tca_wire.text.printable import printable

UNTOUCHED = ' pointer-events="none"'
"""The attribute of an element that must not hide the hover title of a shape below it."""
STYLE = Path(__file__).with_name("svg.css").read_text()
_WIDTHS = {
    "ijl'|": 0.23,
    "ftI.,:;!/ []()": 0.29,
    'r-{}"`*': 0.36,
    "ckszvxyJ": 0.5,
    "wABCDEFGHKNOPQRSUVXYZ&+<=>~": 0.73,
    "mMW@%": 0.92,
}
_WIDTH = 0.6
"""The width of other characters. All widths are relative to the font size, and rounded up."""
_SIZE = 12.0


def width_of(words: str) -> float:
    """Return the approximate width of a text in pixels in the font of ``STYLE``, rounded up."""
    narrow = sum(_WIDTH_OF.get(letter, _WIDTH) for letter in words)
    # A character of two columns is as wide as the font size
    wide = (columns_of(words) - len(words)) * (1.0 - _WIDTH)
    return (narrow + max(wide, 0.0)) * _SIZE * 1.05


_WIDTH_OF = {letter: width for letters, width in _WIDTHS.items() for letter in letters}


def document(width: float, height: float, title: str, style: str, body: Iterable[str]) -> str:
    """Return a whole picture."""
    size = f'width="{width:.0f}" height="{height:.0f}"'
    head = f"""\
<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {width:.0f} {height:.0f}">
<title>{text(title)}</title>
<style>{STYLE}{style}</style>
<rect {size} fill="#ffffff"/>"""
    return "\n".join([head, *body, "</svg>\n"])


def rectangle(
    look: str, left: float, top: float, right: float, height: float, title: str = ""
) -> str:
    """Return a rectangle with a hover title; *look* are attributes, such as its class.

    It is visible even if *right* is not above *left*.
    """
    place = (
        f'x="{left:.2f}" y="{top:.1f}" width="{max(right - left, 0.05):.2f}" height="{height:.1f}"'
    )
    if title:
        return f"<rect {look} {place}><title>{lines(title)}</title></rect>"
    return f"<rect {look} {place}/>"


def words(style: str, x: float, y: float, content: str, more: str = "") -> str:
    """Return a text of the class *style*; *more* are other attributes."""
    return f'<text class="{style}" x="{x:.2f}" y="{y:.1f}"{more}>{text(content)}</text>'


def line(style: str, x: float, y: float, right: float, bottom: float) -> str:
    """Return a straight line of the class *style*."""
    return f'<line class="{style}" x1="{x:.2f}" y1="{y:.1f}" x2="{right:.2f}" y2="{bottom:.1f}"/>'


def text(words: str) -> str:
    """Return a text escaped for SVG."""
    return escape(printable(words))


def lines(words: str) -> str:
    """Return a text of several lines escaped for SVG."""
    return "\n".join(map(text, words.split("\n")))
