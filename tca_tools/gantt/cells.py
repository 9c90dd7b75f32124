"""Lines of characters on a time axis: spans as blocks, with a name if it fits."""

from itertools import groupby
from operator import itemgetter
from pathlib import Path

import click

from tca_tools.gantt.chart import CONNECTED, RESTART, Bar, BarKind, Ending
from tca_tools.terminal import can_show, columns_of, line_width
from tca_wire.coordination import TaskRole
from tca_wire.text.printable import printable

FAILURES = {
    Ending.FAILED: ("!", "red"),
    Ending.HANDLED: ("~", "yellow"),
    Ending.RESOLVED: ("&", "bright_yellow"),
}
MARKS = {**FAILURES, Ending.NONE: ("?", None)}
END, NEXT_CAUSE, TICK = "end", "next cause", "tick"
_DRAWN = (
    BarKind.HANDLED,
    END,
    BarKind.WAITING,
    BarKind.QUEUED,
    BarKind.SUSPENDED,
    BarKind.IDLE,
    BarKind.HELD,
    NEXT_CAUSE,
    BarKind.LOCKED,
    BarKind.RESERVED,
    TICK,
    CONNECTED,
    TaskRole.AHEAD,
    TaskRole.WASTED,
    RESTART,
)
UNICODE = dict(zip(_DRAWN, "█▉▒░┄┄·╎╳╱╵─▀▚↻", strict=True))  # noqa: RUF001 - no letters
ASCII = dict(zip(_DRAWN, "#|=.--:|x/'_^%R", strict=True))
"""By kind of thing: the character that draws it."""
_WIDTH = 120
"""Columns if the width of the terminal is unknown."""


def blocks_for(output: Path | None, *, as_ascii: bool = False) -> dict[str, str]:
    """Return the characters for a file, or those that standard output can show."""
    can_show_all = output is not None or can_show("".join(UNICODE.values()))
    return UNICODE if can_show_all and not as_ascii else ASCII


def width_for(output: Path | None) -> int:
    """Return the number of columns of a file's lines, or of the terminal."""
    return _WIDTH if output else line_width() or _WIDTH


class Cells:
    """A line to draw on, from *start* to *end*: a character and a colour for each column."""

    def __init__(self, start: float, end: float, columns: int) -> None:
        self.start, self.end = start, end
        self.characters = [" "] * columns
        self.colours: list[str | None] = [None] * columns

    def span(self, start: float, end: float) -> tuple[int, int]:
        """Return the first column of a span of at least one column, and the column after it."""
        first = min(self.column(start), len(self.characters) - 1)
        return first, max(first + 1, self.column(end))

    def column(self, time: float) -> int:
        """Return the column of a time; a time outside the line is at its edge."""
        time, length = min(max(time, self.start), self.end), self.end - self.start or 1.0
        return round(len(self.characters) * (time - self.start) / length)

    def paint(
        self, start: float, end: float, character: str, name: str, colour: str | None
    ) -> None:
        """Draw a span of one character, with its name if that fits."""
        first, stop = self.span(start, end)
        line = [character] * (stop - first)
        write_name(line, name)
        self.place(first, line, colour)

    def place(self, first: int, line: list[str], colour: str | None) -> None:
        """Write characters of one colour from column *first* on."""
        self.characters[first : first + len(line)] = line
        self.colours[first : first + len(line)] = [colour] * len(line)

    def add_marks(self, bar: Bar) -> None:
        """Draw the marks of a bar."""
        for mark in bar.marks:
            if self.start <= mark.time <= self.end:
                character, colour = MARKS[mark.ending]
                self.place(self.span(mark.time, mark.time)[0], [character], colour)

    def line(self) -> str:
        """Return the line as text, styled by runs of one colour."""
        runs = groupby(zip(self.characters, self.colours, strict=True), key=itemgetter(1))
        pieces = [(colour, "".join(character for character, _ in run)) for colour, run in runs]
        return "".join(
            click.style(run, fg=colour) if colour else run for colour, run in pieces
        ).rstrip()


def write_name(line: list[str], *names: str) -> None:
    """Write the first name that fits into the longest run of one character in *line*."""
    start = best = length = 0
    for size in (len(list(run)) for _, run in groupby(line)):
        if size > length:
            best, length = start, size
        start += size
    for name in (f" {printable(name)} " for name in names if name):
        if columns_of(name) == len(name) and len(name) + 2 <= length:
            line[best + 1 : best + 1 + len(name)] = name
            return
