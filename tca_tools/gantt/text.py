"""A chart as text: blocks on a time axis, with names where they have room."""

from collections.abc import Iterator
from itertools import cycle, groupby
from operator import itemgetter
from typing import NamedTuple

import click

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.blocks import queue_lengths
from tca_tools.gantt.chart import Bar, Chart, Ending, Kind, Row, lanes_of
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.printable import printable

_WIDEST_LABEL = 32
_MOST_LANES = 8
_MOST_QUEUE_LANES = 4
"""Of a longer queue only the length is shown."""
_FAILURES = {Ending.FAILED: ("!", "red"), Ending.COPED: ("~", "yellow")}
_COLOURS = "blue yellow green magenta cyan bright_blue bright_magenta bright_green bright_cyan"


class Blocks(NamedTuple):
    """The characters of bars."""

    handled: str = "█"
    end: str = "▉"
    waiting: str = "▒"
    queued: str = "░"
    suspended: str = "┄"
    held: str = "·"
    next_cause: str = "╎"
    locked: str = "╳"  # noqa: RUF001 - looks like no letter where it is a long line
    reserved: str = "╱"  # noqa: RUF001
    axis: str = "╵"
    connected: str = "─"


UNICODE, ASCII = Blocks(), Blocks("#", "|", "=", ".", "-", ":", "|", "x", "/", "'", "_")


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
        """The moments at which failures were raised beside its handler."""
        for one in bar.raised:
            if self.chart.shows(one.time):
                character, colour = _FAILURES[one.ending]
                self.put(min(self.column(one.time), len(self.characters) - 1), [character], colour)

    def line(self) -> str:
        """The line, with runs of one colour as one."""
        runs = groupby(zip(self.characters, self.colours, strict=True), key=itemgetter(1))
        pieces = [(colour, "".join(character for character, _ in run)) for colour, run in runs]
        return "".join(click.style(run, fg=colour) if colour else run for colour, run in pieces).rstrip()


def chart_lines(chart: Chart, width: int, blocks: Blocks = UNICODE) -> Iterator[str]:
    """The chart, line by line, in *width* columns."""
    labels = [printable(row.label) for row in chart.rows]
    label_width = min(max(map(columns_of, labels), default=0), _WIDEST_LABEL, width // 2)
    columns = max(width - label_width - 2, 1)
    yield from _axis(chart, label_width, columns, blocks)
    colours = dict(zip(chart.names, cycle(_COLOURS.split()), strict=False))
    for row, label in zip(chart.rows, labels, strict=True):
        for number, cells in enumerate(_row_cells(row, chart, columns, blocks, colours)):
            yield f"{padded('' if number else label, label_width)}  {cells.line()}".rstrip()
    yield ""
    yield from _legend(chart, width, blocks)


def _legend(chart: Chart, width: int, blocks: Blocks) -> Iterator[str]:
    """The meanings of the characters, in lines of at most *width* columns."""
    queued, claims = {bar.kind for row in chart.rows for bar in row.queued}, chart.claims()
    items = [
        (blocks.handled, "handling", True),
        (blocks.waiting, "waiting for a reply, task or lock", True),
        (blocks.queued, "queued", True),
        (blocks.suspended, "suspended", Kind.SUSPENDED in queued),
        (blocks.held, "held", any(row.held for row in chart.rows)),
        (blocks.locked, "locked", Kind.LOCKED in claims),
        (blocks.reserved, "reserved", Kind.RESERVED in claims),
        (blocks.connected, "connected", any(map(_is_idle, chart.rows))),
    ]
    words = [f"{character * 2} {meaning}" for character, meaning, is_seen in items if is_seen]
    failed, raised = {bar.ending for bar in chart.bars()}, {mark.ending for mark in chart.marks()}
    words += [f"{blocks.handled}! failed"] * (Ending.FAILED in failed)
    words += [f"{blocks.handled}~ failed, and handled"] * (Ending.COPED in failed)
    words += ["! failure raised beside the handler"] * (Ending.FAILED in raised)
    words += ["~ the same, and handled"] * (Ending.COPED in raised)
    line = ""
    for word in words:
        if line and len(line) + 2 + len(word) > width:
            yield line
            line = ""
        line += ("  " if line else "") + cut(word, width)
    yield line


def _axis(chart: Chart, label_width: int, columns: int, blocks: Blocks) -> Iterator[str]:
    words, marks = _Cells(chart, columns), _Cells(chart, columns)
    taken = -1
    for time, label in ticks(chart.start, chart.end, max(columns // 12, 1)):
        at = min(words.column(time), columns - 1)
        if at > taken and at + len(label) <= columns:
            words.put(at, list(label), None)
            marks.put(at, [blocks.axis], None)
            taken = at + len(label)
    for cells in (words, marks):
        yield f"{' ' * label_width}  {cells.line()}".rstrip()


def _row_cells(row: Row, chart: Chart, columns: int, blocks: Blocks, colours: dict[str, str]) -> Iterator[_Cells]:
    handled = [_Cells(chart, columns) for _ in range(min(row.lanes, _MOST_LANES))]
    for bar in row.handled:
        _paint_handled(handled[min(bar.lane, _MOST_LANES - 1)], bar, blocks, colours[bar.name])
    for start, end in row.connected if _is_idle(row) else ():
        if chart.shows(start, end):
            handled[0].paint(start, end, blocks.connected, "", "bright_black")
    yield from handled
    if lanes_of(row.queued) > _MOST_QUEUE_LANES:
        yield _long_queue(row, chart, columns, blocks)
    else:
        queued = [_Cells(chart, columns) for _ in range(lanes_of(row.queued))]
        for bar in row.queued:
            character = blocks.suspended if bar.kind is Kind.SUSPENDED else blocks.queued
            queued[bar.lane].paint(bar.start, bar.end, character, bar.name, colours[bar.name])
            queued[bar.lane].mark(bar)
        yield from queued
    yield from _held(row, chart, columns, blocks, colours)
    claims = [one for one in row.claims if chart.shows(one.start, one.end)]
    if claims:
        cells = _Cells(chart, columns)
        for one in claims:
            character = blocks.reserved if one.kind is Kind.RESERVED else blocks.locked
            cells.paint(one.start, one.end, character, f"by {one.name}", "red")
        yield cells


def _held(row: Row, chart: Chart, columns: int, blocks: Blocks, colours: dict[str, str]) -> Iterator[_Cells]:
    """The held tasks, with what each waits for."""
    lanes = [_Cells(chart, columns) for _ in range(min(lanes_of(row.held), _MOST_QUEUE_LANES))]
    for bar in row.held:
        if bar.lane < len(lanes):
            first, behind = lanes[bar.lane].span(bar.start, bar.end)
            words = bar.words(behind - first - 4)
            lanes[bar.lane].paint(bar.start, bar.end, blocks.held, words, colours[bar.name])
            if bar.follows is not None:
                lanes[bar.lane].characters[first] = blocks.next_cause
    if (more := lanes_of(row.held) - _MOST_QUEUE_LANES) > 0:
        lanes.append(_Cells(chart, columns))
        lanes[-1].put(0, list(cut(f"and up to {more} more are held", columns)), None)
    yield from lanes


def _is_idle(row: Row) -> bool:
    """Whether its module was there, and nothing else happened in it."""
    return bool(row.connected) and not any(row.bars)


def _long_queue(row: Row, chart: Chart, columns: int, blocks: Blocks) -> _Cells:
    """How many wait, as numbers where they change."""
    cells, length = _Cells(chart, columns), chart.end - chart.start or 1.0
    character = blocks.suspended if row.queue_kind == Kind.SUSPENDED else blocks.queued
    for start, end, number in queue_lengths(row.queued, chart.start, length / columns):
        cells.paint(start, end, character, str(number), None)
    return cells


def _paint_handled(cells: _Cells, bar: Bar, blocks: Blocks, colour: str) -> None:
    first, behind = cells.span(bar.start, bar.end)
    line = [blocks.handled] * (behind - first)
    if len(line) == 1 and bar.is_waiting:
        line[0] = blocks.waiting
    elif len(line) > 1 and not bar.is_open and bar.end <= cells.chart.end:
        line[-1] = blocks.end  # a hair's breadth to the next bar
    for wait in bar.waits:
        start, end = cells.column(wait.start) - first, min(cells.column(wait.end) - first, len(line))
        line[max(start, 0) : max(end, 0)] = [blocks.waiting] * (end - max(start, 0))
    _write_name(line, *bar.labels)
    if bar.ending in _FAILURES:
        line[-1], colour = _FAILURES[bar.ending]
    cells.put(first, line, colour)
    cells.mark(bar)


def _write_name(line: list[str], *names: str) -> None:
    """Write the first name that has room there into the bar's longest run of one character."""
    runs = [(len(list(run)), character) for character, run in groupby(line)]
    start = best = length = 0
    for size, _ in runs:
        if size > length:
            best, length = start, size
        start += size
    for name in (f" {printable(name)} " for name in names if name):
        if columns_of(name) == len(name) and len(name) + 2 <= length:
            line[best + 1 : best + 1 + len(name)] = name
            return
