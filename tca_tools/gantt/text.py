"""A chart as text: blocks on a time axis, with names where they have room."""

from collections.abc import Iterator
from itertools import cycle

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.blocks import queue_lengths
from tca_tools.gantt.cells import END, FAILURES, MARKS, NEXT_CAUSE, TICK, UNICODE, Cells, write_name
from tca_tools.gantt.chart import CONNECTED, MARKED, MEANINGS, Bar, BarKind, Chart, ResourceRow, lanes_of
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.printable import printable

_WIDEST_LABEL = 32
_MOST_LANES = 8
_MOST_QUEUE_LANES = 4
"""Of a longer queue only the length is shown."""
_COLOURS = "blue yellow green magenta cyan bright_blue bright_magenta bright_green bright_cyan"


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
    looks |= {ending: blocks[BarKind.HANDLED] + character for ending, (character, _) in FAILURES.items()}
    looks |= {words: MARKS[ending][0] for ending, words in MARKED.items()}
    seen, line = chart.seen(), ""
    for word in (f"{looks[key]} {meaning}" for key, meaning in MEANINGS.items() if key in seen and key in looks):
        if line and len(line) + 2 + len(word) > width:
            yield line
            line = ""
        line += ("  " if line else "") + cut(word, width)
    yield line


def _axis(chart: Chart, columns: int, blocks: dict[str, str]) -> Iterator[Cells]:
    words, marks = Cells(chart.start, chart.end, columns), Cells(chart.start, chart.end, columns)
    taken = -1
    for time, label in ticks(chart.start, chart.end, max(columns // 12, 1)):
        at = min(words.column(time), columns - 1)
        if at > taken and at + len(label) <= columns:
            words.put(at, list(label), None)
            marks.put(at, [blocks[TICK]], None)
            taken = at + len(label)
    yield from (words, marks)


def _row_cells(
    row: ResourceRow, chart: Chart, columns: int, blocks: dict[str, str], colours: dict[str, str]
) -> Iterator[Cells]:
    handled = [Cells(chart.start, chart.end, columns) for _ in range(min(row.lanes, _MOST_LANES))]
    for bar in row.handled:
        paint_handled(handled[min(bar.lane, _MOST_LANES - 1)], bar, blocks, colours[bar.name])
    for start, end in row.connected if row.is_idle else ():
        if chart.shows(start, end):
            handled[0].paint(start, end, blocks[CONNECTED], "", "bright_black")
    yield from handled
    queued = [Cells(chart.start, chart.end, columns) for _ in range(lanes_of(row.queued))]
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
    cells = Cells(chart.start, chart.end, columns)
    for one in claims:
        cells.paint(one.start, one.end, blocks[one.kind], f"by {one.name}", "red")
    yield from [cells] * bool(claims)


def _held(
    row: ResourceRow, chart: Chart, columns: int, blocks: dict[str, str], colours: dict[str, str]
) -> Iterator[Cells]:
    """The held tasks, with what each waits for."""
    count = lanes_of(row.held)
    lanes = [Cells(chart.start, chart.end, columns) for _ in range(min(count, _MOST_QUEUE_LANES + 1))]
    for bar in row.held:
        if bar.lane < _MOST_QUEUE_LANES:
            first, behind = lanes[bar.lane].span(bar.start, bar.end)
            words = bar.words(behind - first - 4)
            lanes[bar.lane].paint(bar.start, bar.end, blocks[BarKind.HELD], words, colours[bar.name])
            if bar.follows is not None:
                lanes[bar.lane].characters[first] = blocks[NEXT_CAUSE]
    if count > _MOST_QUEUE_LANES:
        lanes[-1].put(0, list(cut(f"and up to {count - _MOST_QUEUE_LANES} more are held", columns)), None)
    yield from lanes


def paint_handled(cells: Cells, bar: Bar, blocks: dict[str, str], colour: str | None) -> None:
    """A bar, with its parts and its end."""
    first, behind = cells.span(bar.start, bar.end)
    line = [blocks[BarKind.HANDLED]] * (behind - first)
    if bar.ahead:
        count = max(min(cells.column(bar.ahead[1]) - first, len(line)), 1)
        line[:count] = [blocks[bar.preview]] * count
    if len(line) == 1 and bar.is_waiting:
        line[0] = blocks[BarKind.WAITING]
    elif len(line) > 1 and not bar.is_open and bar.end <= cells.end:
        line[-1] = blocks[END]  # a hair's breadth to the next bar
    for wait in bar.waits:
        start, end = cells.column(wait.start) - first, min(cells.column(wait.end) - first, len(line))
        line[max(start, 0) : max(end, 0)] = [blocks[BarKind.WAITING]] * (end - max(start, 0))
    write_name(line, *bar.labels)
    if bar.ending in FAILURES:
        line[-1], colour = FAILURES[bar.ending]
    cells.put(first, line, colour)
    cells.mark(bar)
