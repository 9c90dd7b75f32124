"""The small things that our SVG pictures are made of: rectangles, texts, documents and their common
look.
"""

from collections.abc import Iterable
from html import escape
from pathlib import Path

from tca_tools.terminal import columns_of
from tca_wire.text.printable import printable

UNTOUCHED = ' pointer-events="none"'
"""For what lies over a shape whose title is wanted at the mouse."""
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
"""Of other characters; all as parts of the size of the letters, in the fonts above, rounded up."""
_SIZE = 12.0


def width_of(words: str) -> float:
    """About how many pixels wide a text is in the letters of ``STYLE``; rather too many than too
    few.
    """
    narrow = sum(_WIDTH_OF.get(letter, _WIDTH) for letter in words)
    wide = (columns_of(words) - len(words)) * (
        1.0 - _WIDTH
    )  # such letters take the room of two columns
    return (narrow + max(wide, 0.0)) * _SIZE * 1.05


_WIDTH_OF = {letter: width for letters, width in _WIDTHS.items() for letter in letters}


def document(width: float, height: float, title: str, style: str, body: Iterable[str]) -> str:
    """A whole picture."""
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
    """A rectangle with its title; *right* may be no more than *left*, but it stays visible then."""
    place = (
        f'x="{left:.2f}" y="{top:.1f}" width="{max(right - left, 0.05):.2f}" height="{height:.1f}"'
    )
    if title:
        return f"<rect {look} {place}><title>{lines(title)}</title></rect>"
    return f"<rect {look} {place}/>"


def words(look: str, x: float, y: float, said: str, more: str = "") -> str:
    """A text of the class *look*; *more*: other attributes."""
    return f'<text class="{look}" x="{x:.2f}" y="{y:.1f}"{more}>{text(said)}</text>'


def line(look: str, x: float, y: float, right: float, bottom: float) -> str:
    """A straight line of the class *look*."""
    return f'<line class="{look}" x1="{x:.2f}" y1="{y:.1f}" x2="{right:.2f}" y2="{bottom:.1f}"/>'


def text(words: str) -> str:
    """*words* as SVG takes them."""
    return escape(printable(words))


def lines(words: str) -> str:
    """Several lines of *words* as SVG takes them."""
    return "\n".join(map(text, words.split("\n")))
