"""Text that fits a terminal: width, cutting, padding, and no control characters from foreign
text.
"""

import os
import select
import shutil
import sys
import unicodedata
from collections.abc import Sequence

_LEAST_NAME = 6
"""Columns that are left of a name before its number."""


def line_width() -> int | None:
    """The columns a line may take; None if nobody looks (a pipe or file), so nothing need be
    cut.
    """
    if os.environ.get("COLUMNS", "").isdecimal() or sys.stdout.isatty():
        return shutil.get_terminal_size().columns
    return None


def columns_of(text: str) -> int:
    """How many columns *text* takes: wide characters take two, combining ones none."""
    if text.isascii():
        return len(text)
    return sum(map(_columns, text))


def cut(text: str, width: int | None) -> str:
    """*text* in at most *width* columns; what is missing shows as "…"."""
    if width is None or columns_of(text) <= width:
        return text
    kept, room = [], width - 1
    for character in text:
        room -= _columns(character)
        if room < 0:
            break
        kept.append(character)
    return "".join(kept) + "…" * (width > 0)


def cut_name(text: str, number: int, width: int) -> str:
    """Cut a task's name but keep its number, and the text behind that if it has room: ``pour a …
    {24}``.
    """
    name, marker, after = text.rpartition(f" {{{number}}}")
    if not name or columns_of(text) <= width:
        return cut(text, width)
    end = next(
        (one for one in (marker + after, marker) if columns_of(one) + _LEAST_NAME <= width), ""
    )
    return cut(name if end else text, width - columns_of(end)) + end


def padded(text: str, width: int) -> str:
    """*text* in exactly *width* columns, cut if need be."""
    text = cut(text, width)
    return text + " " * (width - columns_of(text))


def table_lines(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of cells as lines, with columns as wide as their widest cell."""
    widths = [max(map(columns_of, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(padded, row, widths)).rstrip() for row in rows]


def can_show(characters: str) -> bool:
    """Whether standard output's encoding has these characters."""
    try:
        characters.encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def is_hung_up(terminal: int) -> bool:
    """Whether a terminal has gone, as told by its descriptor."""
    asked = select.poll()
    asked.register(terminal, 0)
    return bool(asked.poll(0))


def _columns(character: str) -> int:
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1
