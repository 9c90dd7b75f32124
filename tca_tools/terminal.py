"""Text that fits a terminal: widths, cutting, padding and tables."""

import os
import re
import select
import shutil
import sys
import unicodedata
from collections.abc import Iterable, Sequence

_LEAST_NAME = 6
"""Columns of a name before its number, at least."""


def line_width() -> int | None:
    """Return the columns of a line; None if standard output is a pipe or file without a limit."""
    if os.environ.get("COLUMNS", "").isdecimal() or sys.stdout.isatty():
        return shutil.get_terminal_size().columns
    return None


def columns_of(text: str) -> int:
    """Return the columns of a text: wide characters take two, combining characters none."""
    if text.isascii():
        return len(text)
    return sum(map(_columns, text))


def cut(text: str, width: int | None) -> str:
    """Cut a text to at most *width* columns. A text that was cut ends with "…"."""
    if width is None or columns_of(text) <= width:
        return text
    start, room = [], width - 1
    for character in text:
        room -= _columns(character)
        if room < 0:
            break
        start.append(character)
    return "".join(start) + "…" * (width > 0)


def cut_name(text: str, number: int, width: int) -> str:
    """Cut a task's name but retain its number, and the text after it if there is room.

    For example ``pour a … {24}``.
    """
    name, marker, after = text.rpartition(f" {{{number}}}")
    if not name or columns_of(text) <= width:
        return cut(text, width)
    end = next(
        (one for one in (marker + after, marker) if columns_of(one) + _LEAST_NAME <= width), ""
    )
    return cut(name if end else text, width - columns_of(end)) + end


def padded(text: str, width: int) -> str:
    """Return a text in exactly *width* columns, cut if necessary."""
    text = cut(text, width)
    return text + " " * (width - columns_of(text))


def table_lines(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines, with columns as wide as their widest cell."""
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
    """Whether the terminal of a file descriptor was closed."""
    poll = select.poll()
    poll.register(terminal, 0)
    return bool(poll.poll(0))


def _columns(character: str) -> int:
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def for_shell(names: Iterable[str], start: str) -> list[str]:
    """Return the names that begin with *start*, as the shell that asks for a completion reads them.

    Bash takes a word as it is, so that spaces need a backslash. Other shells quote it themselves.
    """
    found = sorted({name for name in names if name.startswith(start)})
    if os.environ.get("_TCA_COMPLETE", "").startswith("bash"):
        return [re.sub(r"([^\w.,:/+-])", r"\\\1", name) for name in found]
    return found
