"""A chart as text: blocks on a time axis, with names where they have room."""

from collections.abc import Iterator
from itertools import cycle, groupby
from operator import itemgetter

import click

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.blocks import queue_lengths
from tca_tools.gantt.chart import CONNECTED, MARKED, MEANINGS, Bar, BarKind, Chart, Ending, ResourceRow, lanes_of
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.printable import printable

_WIDEST_LABEL = 32
_MOST_LANES = 8
_MOST_QUEUE_LANES = 4
"""Of a longer queue only the length is shown."""
_FAILURES = {Ending.FAILED: ("!", "red"), Ending.COPED: ("~", "yellow")}
_MARKS = {**_FAILURES, Ending.NONE: ("?", None)}
_COLOURS = "blue yellow green magenta cyan bright_blue bright_magenta bright_green bright_cyan"
_END, _NEXT_CAUSE, _TICK = "end", "next cause", "tick"
_DRAWN = (
    BarKind.HANDLED, _END, BarKind.WAITING, BarKind.QUEUED, BarKind.SUSPENDED, BarKind.HELD, _NEXT_CAUSE,
    BarKind.LOCKED, BarKind.RESERVED, _TICK, CONNECTED,
)  # fmt: skip
UNICODE = dict(zip(_DRAWN, "█▉▒░┄·╎╳╱╵─", strict=True))  # noqa: RUF001 - they look like no letters in a long line
ASCII = dict(zip(_DRAWN, "#|=.-:|x/'_", strict=True))
"""The characters of what is drawn."""


class _Cells:
    """One line of the chart being drawn: a character and a colour for each column."""

    def __init__(self, chart: Chart, columns: int) -> None:
        self.chart = chart
        self.characters = [" "] * columns
        self.colours: list[str | None] = [None] * columns

    def span(self, start: float, end: float) -> tuple[int, int]:
        """The columns of a span, first and behind the last; at least one, however short it is."""
        first = min(self.column(start), len(self.characters) - 1)
        return first, max(first + 1, self.column(end))

    def column(self, time: float) -> int:
        """Where a time stands; at the edge, if it is beyond."""
        chart = self.chart
        time, length = min(max(time, chart.start), chart.end), chart.end - chart.start or 1.0
        return round(len(self.characters) * (time - chart.start) / length)

    def paint(self, start: float, end: float, character: str, name: str, colour: str | None) -> None:
        """A span of one character, with its name if that has room."""
        first, behind = self.span(start, end)
        line = [character] * (behind - first)
        _write_name(line, name)
        self.put(first, line, colour)

    def put(self, first: int, line: list[str], colour: str | None) -> None:
        """Characters of one colour."""
        self.characters[first : first + len(line)] = line
        self.colours[first : first + len(line)] = [colour] * len(line)

    def mark(self, bar: Bar) -> None:
        """Its marks."""
        for one in bar.marks:
            if self.chart.shows(one.time):
                character, colour = _MARKS[one.ending]
                self.put(self.span(one.time, one.time)[0], [character], colour)

    def line(self) -> str:
        """The line, with runs of one colour as one."""
        runs = groupby(zip(self.characters, self.colours, strict=True), key=itemgetter(1))
        pieces = [(colour, "".join(character for character, _ in run)) for colour, run in runs]
        return "".join(click.style(run, fg=colour) if colour else run for colour, run in pieces).rstrip()


def chart_lines(chart: Chart, width: int, blocks: dict[str, str] = UNICODE) -> Iterator[str]:
    """The chart, line by line, in *width* columns."""
    labels = [printable(row.label) for row in chart.rows]
    label_width = min(max(map(columns_of, labels), default=0), _WIDEST_LABEL, width // 2)
    columns = max(width - label_width - 2, 1)
    for cells in _axis(chart, columns, blocks):
        yield f"{' ' * label_width}  {cells.line()}".rstrip()
    colours = dict(zip(chart.names, cycle(_COLOURS.split()), strict=False))
    for row, label in zip(chart.rows, labels, strict=True):
        for number, cells in enumerate(_row_cells(row, chart, columns, blocks, colours)):
            yield f"{padded('' if number else label, label_width)}  {cells.line()}".rstrip()
    yield ""
    yield from _legend(chart, width, blocks)


def _legend(chart: Chart, width: int, blocks: dict[str, str]) -> Iterator[str]:
    """The meanings of the characters, in lines of at most *width* columns."""
    looks = {kind: character * 2 for kind, character in blocks.items()}
    looks |= {ending: blocks[BarKind.HANDLED] + character for ending, (character, _) in _FAILURES.items()}
    looks |= {MARKED[ending]: character for ending, (character, _) in _MARKS.items()}
    seen, line = chart.seen(), ""
    for word in (f"{looks[key]} {meaning}" for key, meaning in MEANINGS.items() if key in seen and key in looks):
        if line and len(line) + 2 + len(word) > width:
            yield line
            line = ""
        line += ("  " if line else "") + cut(word, width)
    yield line


def _axis(chart: Chart, columns: int, blocks: dict[str, str]) -> Iterator[_Cells]:
    words, marks = _Cells(chart, columns), _Cells(chart, columns)
    taken = -1
    for time, label in ticks(chart.start, chart.end, max(columns // 12, 1)):
        at = min(words.column(time), columns - 1)
        if at > taken and at + len(label) <= columns:
            words.put(at, list(label), None)
            marks.put(at, [blocks[_TICK]], None)
            taken = at + len(label)
    yield from (words, marks)


def _row_cells(
    row: ResourceRow, chart: Chart, columns: int, blocks: dict[str, str], colours: dict[str, str]
) -> Iterator[_Cells]:
    handled = [_Cells(chart, columns) for _ in range(min(row.lanes, _MOST_LANES))]
    for bar in row.handled:
        _paint_handled(handled[min(bar.lane, _MOST_LANES - 1)], bar, blocks, colours[bar.name])
    for start, end in row.connected if row.is_idle else ():
        if chart.shows(start, end):
            handled[0].paint(start, end, blocks[CONNECTED], "", "bright_black")
    yield from handled
    queued = [_Cells(chart, columns) for _ in range(lanes_of(row.queued))]
    if len(queued) > _MOST_QUEUE_LANES:  # how many wait, as numbers where they change
        kind, column = row.queued[0].kind, (chart.end - chart.start or 1.0) / columns
        for start, end, number in queue_lengths(row.queued, chart.start, column):
            queued[0].paint(start, end, blocks[kind], str(number), None)
        yield queued[0]
    else:
        for bar in row.queued:
            queued[bar.lane].paint(bar.start, bar.end, blocks[bar.kind], bar.name, colours[bar.name])
            queued[bar.lane].mark(bar)
        yield from queued
    yield from _held(row, chart, columns, blocks, colours)
    claims = [one for one in row.claims if chart.shows(one.start, one.end)]
    cells = _Cells(chart, columns)
    for one in claims:
        cells.paint(one.start, one.end, blocks[one.kind], f"by {one.name}", "red")
    yield from [cells] * bool(claims)


def _held(
    row: ResourceRow, chart: Chart, columns: int, blocks: dict[str, str], colours: dict[str, str]
) -> Iterator[_Cells]:
    """The held tasks, with what each waits for."""
    count = lanes_of(row.held)
    lanes = [_Cells(chart, columns) for _ in range(min(count, _MOST_QUEUE_LANES + 1))]
    for bar in row.held:
        if bar.lane < _MOST_QUEUE_LANES:
            first, behind = lanes[bar.lane].span(bar.start, bar.end)
            words = bar.words(behind - first - 4)
            lanes[bar.lane].paint(bar.start, bar.end, blocks[BarKind.HELD], words, colours[bar.name])
            if bar.follows is not None:
                lanes[bar.lane].characters[first] = blocks[_NEXT_CAUSE]
    if count > _MOST_QUEUE_LANES:
        lanes[-1].put(0, list(cut(f"and up to {count - _MOST_QUEUE_LANES} more are held", columns)), None)
    yield from lanes


def _paint_handled(cells: _Cells, bar: Bar, blocks: dict[str, str], colour: str) -> None:
    first, behind = cells.span(bar.start, bar.end)
    line = [blocks[BarKind.HANDLED]] * (behind - first)
    if len(line) == 1 and bar.is_waiting:
        line[0] = blocks[BarKind.WAITING]
    elif len(line) > 1 and not bar.is_open and bar.end <= cells.chart.end:
        line[-1] = blocks[_END]  # a hair's breadth to the next bar
    for wait in bar.waits:
        start, end = cells.column(wait.start) - first, min(cells.column(wait.end) - first, len(line))
        line[max(start, 0) : max(end, 0)] = [blocks[BarKind.WAITING]] * (end - max(start, 0))
    _write_name(line, *bar.labels)
    if bar.ending in _FAILURES:
        line[-1], colour = _FAILURES[bar.ending]
    cells.put(first, line, colour)
    cells.mark(bar)


def _write_name(line: list[str], *names: str) -> None:
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
