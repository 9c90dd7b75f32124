"""Lines of characters on a time axis: spans as blocks, with names where they have room."""

from itertools import groupby
from operator import itemgetter
from pathlib import Path

import click

from tca_tools.gantt.chart import CONNECTED, Bar, BarKind, Ending
from tca_tools.terminal import can_show, columns_of, line_width
from tca_wire.coordination import TaskRole
from tca_wire.text.printable import printable

FAILURES = {
    Ending.FAILED: ("!", "red"),
    Ending.COPED: ("~", "yellow"),
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
)
UNICODE = dict(zip(_DRAWN, "█▉▒░┄┄·╎╳╱╵─▀▚", strict=True))  # noqa: RUF001 - they look like no letters in a long line
ASCII = dict(zip(_DRAWN, "#|=.--:|x/'_^%", strict=True))
"""The characters of what is drawn."""
_WIDTH = 120
"""Columns where the width of the terminal is unknown."""


def blocks_for(output: Path | None, *, as_ascii: bool = False) -> dict[str, str]:
    """The characters for a file, or for what standard output can show."""
    can_show_all = output is not None or can_show("".join(UNICODE.values()))
    return UNICODE if can_show_all and not as_ascii else ASCII


def width_for(output: Path | None) -> int:
    """Columns of the lines of a file, or of the terminal."""
    return _WIDTH if output else line_width() or _WIDTH


class Cells:
    """One line being drawn, from *start* to *end*: a character and a colour for each column."""

    def __init__(self, start: float, end: float, columns: int) -> None:
        self.start, self.end = start, end
        self.characters = [" "] * columns
        self.colours: list[str | None] = [None] * columns

    def span(self, start: float, end: float) -> tuple[int, int]:
        """The columns of a span, first and behind the last; at least one, however short it is."""
        first = min(self.column(start), len(self.characters) - 1)
        return first, max(first + 1, self.column(end))

    def column(self, time: float) -> int:
        """Where a time stands; at the edge, if it is beyond."""
        time, length = min(max(time, self.start), self.end), self.end - self.start or 1.0
        return round(len(self.characters) * (time - self.start) / length)

    def paint(
        self, start: float, end: float, character: str, name: str, colour: str | None
    ) -> None:
        """A span of one character, with its name if that has room."""
        first, behind = self.span(start, end)
        line = [character] * (behind - first)
        write_name(line, name)
        self.put(first, line, colour)

    def put(self, first: int, line: list[str], colour: str | None) -> None:
        """Characters of one colour."""
        self.characters[first : first + len(line)] = line
        self.colours[first : first + len(line)] = [colour] * len(line)

    def mark(self, bar: Bar) -> None:
        """Its marks."""
        for one in bar.marks:
            if self.start <= one.time <= self.end:
                character, colour = MARKS[one.ending]
                self.put(self.span(one.time, one.time)[0], [character], colour)

    def line(self) -> str:
        """The line, with runs of one colour as one."""
        runs = groupby(zip(self.characters, self.colours, strict=True), key=itemgetter(1))
        pieces = [(colour, "".join(character for character, _ in run)) for colour, run in runs]
        return "".join(
            click.style(run, fg=colour) if colour else run for colour, run in pieces
        ).rstrip()


def write_name(line: list[str], *names: str) -> None:
    """Write the first name that has room there into the bar's longest run of one character."""
    start = best = length = 0
    for size in (len(list(run)) for _, run in groupby(line)):
        if size > length:
            best, length = start, size
        start += size
    for name in (f" {printable(name)} " for name in names if name):
        if columns_of(name) == len(name) and len(name) + 2 <= length:
            line[best + 1 : best + 1 + len(name)] = name
            return
