"""A chart as text: blocks on a time axis, with names where they have room."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import click

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.blocks import queue_lengths
from tca_tools.gantt.parts import Bar, Chart, Row
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.printable import printable

_WIDEST_LABEL = 32
_MOST_LANES = 8
_MOST_QUEUE_LANES = 4
"""Of a longer queue only the length is shown."""
_FAILED, _COPED = "!", "~"
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
    yield from _legend(chart, width, blocks)


def _legend(chart: Chart, width: int, blocks: Blocks) -> Iterator[str]:
    """What the characters that may be seen mean, in lines of at most *width* columns."""
    queued = [bar for row in chart.rows for bar in row.queued]
    held = [one for row in chart.rows for one in row.held]
    items = [(blocks.handled, "handling"), (blocks.waiting, "waiting for a reply, task or lock")]
    items += [(blocks.queued, "queued")]
    items += [(blocks.suspended, "suspended")] * any(bar.is_suspended for bar in queued)
    items += [(blocks.held, "held")] * any(row.held_back for row in chart.rows)
    items += [(blocks.locked, "locked")] * any(not one.is_reserved for one in held)
    items += [(blocks.reserved, "reserved")] * any(one.is_reserved for one in held)
    items += [(blocks.connected, "connected")] * any(map(_is_idle, chart.rows))
    words = [f"{character * 2} {meaning}" for character, meaning in items]
    failed = {bar.has_coped for row in chart.rows for bar in row.handled if bar.has_failed}
    words += [f"{blocks.handled}{_FAILED} failed"] * (False in failed)
    words += [f"{blocks.handled}{_COPED} failed, and handled"] * (True in failed)
    marks = [mark for row in chart.rows for bar in (*row.handled, *row.queued) for mark in bar.raised]
    raised = {mark.has_coped for mark in marks if chart.start <= mark.time <= chart.end}
    words += [f"{_FAILED} failure raised beside the handler"] * (False in raised)
    words += [f"{_COPED} the same, and handled"] * (True in raised)
    line = ""
    for word in words:
        if line and len(line) + 2 + len(word) > width:
            yield line
            line = ""
        line += ("  " if line else "") + cut(word, width)
    yield line


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
    if _is_idle(row):
        for start, end in row.connected:
            if end >= chart.start and start <= chart.end:
                _paint_run(handled[0], start, end, chart, blocks.connected, "", "bright_black")
    yield from handled
    if row.queue_lanes > _MOST_QUEUE_LANES:
        yield _long_queue(row, chart, columns, blocks)
    else:
        queued = [_Cells([" "] * columns, [None] * columns) for _ in range(row.queue_lanes)]
        for bar in row.queued:
            character = blocks.suspended if bar.is_suspended else blocks.queued
            _paint_run(queued[bar.lane], bar.start, bar.end, chart, character, bar.name, colours[bar.name])
            _paint_marks(queued[bar.lane], bar, chart)
        yield from queued
    yield from _held_back(row, chart, columns, blocks, colours)
    held = [one for one in row.held if one.end >= chart.start and one.start <= chart.end]
    if held:
        cells = _Cells([" "] * columns, [None] * columns)
        for one in held:
            character = blocks.reserved if one.is_reserved else blocks.locked
            _paint_run(cells, one.start, one.end, chart, character, f"by {one.owner}", "red")
        yield cells


def _held_back(row: Row, chart: Chart, columns: int, blocks: Blocks, colours: dict[str, str]) -> Iterator[_Cells]:
    """What constraints hold back, with what that waits for."""
    lanes = [_Cells([" "] * columns, [None] * columns) for _ in range(min(row.held_lanes, _MOST_QUEUE_LANES))]
    for bar in row.held_back:
        if bar.lane < len(lanes):
            first, behind = _columns(bar.start, bar.end, chart, columns)
            words = bar.words(behind - first - 4)
            _paint_run(lanes[bar.lane], bar.start, bar.end, chart, blocks.held, words, colours[bar.name])
            if bar.first is not None:
                lanes[bar.lane].characters[first] = blocks.next_cause
    if (more := row.held_lanes - _MOST_QUEUE_LANES) > 0:
        told = cut(f"and up to {more} more are held", columns).ljust(columns)
        lanes.append(_Cells(list(told), [None] * columns))
    yield from lanes


def _is_idle(row: Row) -> bool:
    """Whether its module was there, and nothing else happened in it."""
    return bool(row.connected) and not row.bars


def _long_queue(row: Row, chart: Chart, columns: int, blocks: Blocks) -> _Cells:
    """How many wait, as numbers where they change."""
    cells = _Cells([" "] * columns, [None] * columns)
    character = blocks.suspended if row.queue_kind == "suspended" else blocks.queued
    for start, end, number in queue_lengths(row.queued, chart.start, _length(chart) / columns):
        _paint_run(cells, start, end, chart, character, str(number), None)
    return cells


def _paint(cells: _Cells, bar: Bar, chart: Chart, blocks: Blocks, colour: str) -> None:
    first, behind = _columns(bar.start, bar.end, chart, len(cells.characters))
    line = [blocks.handled] * (behind - first)
    if len(line) == 1 and bar.is_waiting:
        line[0] = blocks.waiting
    elif len(line) > 1 and not bar.is_open and bar.end <= chart.end:
        line[-1] = blocks.end  # a hair's breadth to the next bar
    for wait in bar.waits:
        start, end = (_column(time, chart, len(cells.characters)) for time in (wait.start, wait.end))
        for at in range(max(start - first, 0), min(end - first, len(line))):
            line[at] = blocks.waiting
    _write_name(line, *bar.labels)
    if bar.has_failed:
        line[-1] = _COPED if bar.has_coped else _FAILED
        colour = "yellow" if bar.has_coped else "red"
    cells.characters[first:behind] = line
    cells.colours[first:behind] = [colour] * len(line)
    _paint_marks(cells, bar, chart)


def _paint_marks(cells: _Cells, bar: Bar, chart: Chart) -> None:
    """The moments at which failures were raised beside its handler."""
    for mark in bar.raised:
        if chart.start <= mark.time <= chart.end:
            at = min(_column(mark.time, chart, len(cells.characters)), len(cells.characters) - 1)
            cells.characters[at] = _COPED if mark.has_coped else _FAILED
            cells.colours[at] = "yellow" if mark.has_coped else "red"


def _paint_run(
    cells: _Cells, start: float, end: float, chart: Chart, character: str, name: str, colour: str | None
) -> None:
    """A span of one character, with its name if that has room."""
    first, behind = _columns(start, end, chart, len(cells.characters))
    line = [character] * (behind - first)
    _write_name(line, name)
    cells.characters[first:behind] = line
    cells.colours[first:behind] = [colour] * len(line)


def _write_name(line: list[str], *names: str) -> None:
    """Write the first name that has room there into the bar's longest run of one character."""
    start = best = length = 0
    for end in range(1, len(line) + 1):
        if end == len(line) or line[end] != line[start]:
            if end - start > length:
                best, length = start, end - start
            start = end
    for name in (f" {printable(name)} " for name in names if name):
        if columns_of(name) == len(name) and len(name) + 2 <= length:
            line[best + 1 : best + 1 + len(name)] = name
            return


def _length(chart: Chart) -> float:
    return chart.end - chart.start or 1.0


def _column(time: float, chart: Chart, columns: int) -> int:
    return round(columns * (min(max(time, chart.start), chart.end) - chart.start) / _length(chart))


def _columns(start: float, end: float, chart: Chart, columns: int) -> tuple[int, int]:
    """The columns of a span, first and behind the last; at least one, however short it is."""
    first = min(_column(start, chart, columns), columns - 1)
    return first, max(first + 1, _column(end, chart, columns))
