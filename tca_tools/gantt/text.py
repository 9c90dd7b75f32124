"""A chart as text: blocks on a time axis, with names where they have room."""

from collections.abc import Iterator
from dataclasses import dataclass

import click

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.bars import Bar, Chart, Row
from tca_tools.terminal import columns_of, padded, printable

_WIDEST_LABEL = 32
_MOST_LANES = 8
_FAILED = "!"
_COLOURS = (
    "blue",
    "yellow",
    "green",
    "magenta",
    "cyan",
    "bright_blue",
    "bright_magenta",
    "bright_green",
    "bright_cyan",
)


@dataclass(frozen=True)
class Blocks:
    """The characters of bars."""

    handled: str = "█"
    end: str = "▉"
    waiting: str = "▒"
    queued: str = "░"
    axis: str = "╵"


UNICODE, ASCII = Blocks(), Blocks("#", "|", "=", ".", "'")


@dataclass(slots=True)
class _Cells:
    """One line of the chart being drawn: a character and a colour for each column."""

    characters: list[str]
    colours: list[str | None]

    def line(self) -> str:
        """The line, with runs of one colour as one."""
        pieces: list[str] = []
        start = 0
        for end in range(1, len(self.characters) + 1):
            if end == len(self.characters) or self.colours[end] != self.colours[start]:
                run = "".join(self.characters[start:end])
                pieces.append(click.style(run, fg=self.colours[start]) if self.colours[start] else run)
                start = end
        return "".join(pieces).rstrip()


def chart_lines(chart: Chart, width: int, blocks: Blocks = UNICODE) -> Iterator[str]:
    """The chart, line by line, in *width* columns."""
    labels = [printable(row.label) for row in chart.rows]
    label_width = min(max(map(columns_of, labels), default=0), _WIDEST_LABEL, width // 2)
    columns = max(width - label_width - 2, 1)
    yield from _axis(chart, label_width, columns, blocks)
    colours = {name: _COLOURS[number % len(_COLOURS)] for number, name in enumerate(chart.names)}
    for row, label in zip(chart.rows, labels, strict=True):
        for number, cells in enumerate(_row_cells(row, chart, columns, blocks, colours)):
            yield f"{padded('' if number else label, label_width)}  {cells.line()}".rstrip()
    yield ""
    words = (
        f"{blocks.handled * 2} handling  {blocks.waiting * 2} waiting for a reply or task  {blocks.queued * 2} queued"
    )
    has_failed = any(bar.has_failed for row in chart.rows for bar in row.handled)
    yield words + (f"  {blocks.handled}{_FAILED} failed" if has_failed else "")


def _axis(chart: Chart, label_width: int, columns: int, blocks: Blocks) -> Iterator[str]:
    words, marks = [" "] * columns, [" "] * columns
    taken = -1
    for time, label in ticks(chart.start, chart.end, max(columns // 12, 1)):
        at = min(_column(time, chart, columns), columns - 1)
        if at > taken and at + len(label) <= columns:
            words[at : at + len(label)] = label
            marks[at] = blocks.axis
            taken = at + len(label)
    for line in (words, marks):
        yield f"{' ' * label_width}  {''.join(line)}".rstrip()


def _row_cells(row: Row, chart: Chart, columns: int, blocks: Blocks, colours: dict[str, str]) -> Iterator[_Cells]:
    handled = [_Cells([" "] * columns, [None] * columns) for _ in range(min(row.lanes, _MOST_LANES))]
    for bar in row.handled:
        _paint(handled[min(bar.lane, _MOST_LANES - 1)], bar, chart, blocks, colours[bar.name])
    yield from handled
    queued = [_Cells([" "] * columns, [None] * columns) for _ in range(min(row.queue_lanes, _MOST_LANES))]
    for bar in row.queued:
        _paint_queued(queued[min(bar.lane, _MOST_LANES - 1)], bar, chart, blocks, colours[bar.name])
    yield from queued


def _paint(cells: _Cells, bar: Bar, chart: Chart, blocks: Blocks, colour: str) -> None:
    first, behind = _columns(bar.start, bar.end, chart, len(cells.characters))
    line = [blocks.handled] * (behind - first)
    if len(line) > 1 and not bar.is_open:
        line[-1] = blocks.end  # a hair's breadth to the next bar
    for wait in bar.waits:
        start, end = (_column(time, chart, len(cells.characters)) for time in (wait.start, wait.end))
        for at in range(max(start - first, 0), min(end - first, len(line))):
            line[at] = blocks.waiting
    _write_name(line, bar.name)
    if bar.has_failed:
        line[-1] = _FAILED
    cells.characters[first:behind] = line
    cells.colours[first:behind] = ["red" if bar.has_failed else colour] * len(line)


def _paint_queued(cells: _Cells, bar: Bar, chart: Chart, blocks: Blocks, colour: str) -> None:
    first, behind = _columns(bar.start, bar.end, chart, len(cells.characters))
    line = [blocks.queued] * (behind - first)
    _write_name(line, bar.name)
    cells.characters[first:behind] = line
    cells.colours[first:behind] = [colour] * len(line)


def _write_name(line: list[str], name: str) -> None:
    """Write the name into the bar's longest run of one character, if it has room there."""
    name = f" {printable(name)} "
    start = best = length = 0
    for end in range(1, len(line) + 1):
        if end == len(line) or line[end] != line[start]:
            if end - start > length:
                best, length = start, end - start
            start = end
    if columns_of(name) == len(name) and len(name) + 2 <= length:
        line[best + 1 : best + 1 + len(name)] = name


def _length(chart: Chart) -> float:
    return chart.end - chart.start or 1.0


def _column(time: float, chart: Chart, columns: int) -> int:
    return min(max(round(columns * (time - chart.start) / _length(chart)), 0), columns)


def _columns(start: float, end: float, chart: Chart, columns: int) -> tuple[int, int]:
    """The columns of a span, first and behind the last; at least one, however short it is."""
    first = min(_column(start, chart, columns), columns - 1)
    return first, max(first + 1, _column(end, chart, columns))
