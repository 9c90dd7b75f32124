"""A chart as text: blocks on a time axis, with names if they fit."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import cycle

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.blocks import queue_lengths
from tca_tools.gantt.cells import END, FAILURES, MARKS, NEXT_CAUSE, TICK, UNICODE, Cells, write_name
from tca_tools.gantt.chart import (
    CONNECTED,
    MARKED,
    MEANINGS,
    RESTART,
    Bar,
    BarKind,
    Chart,
    ResourceRow,
    lanes_of,
)
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.printable import printable
from tca_wire.vocabulary import CENTRAL

_WIDEST_LABEL = 32
_MOST_LANES = 8
_MOST_QUEUE_LANES = 4
"""The most lanes of a queue; of a longer one only the length is shown."""
_COLOURS = "blue yellow green magenta cyan bright_blue bright_magenta bright_green bright_cyan"


def chart_lines(chart: Chart, width: int, blocks: dict[str, str] = UNICODE) -> Iterator[str]:
    """Yield the lines of a chart, in *width* columns."""
    page = TextPage([chart], width, blocks)
    columns = page.columns
    yield from page.lines("", page.axis(ticks(chart.start, chart.end, max(columns // 12, 1))))
    yield from page.restarts(chart)
    yield from page.rows(chart)
    yield ""
    seen = chart.legend_keys()
    yield from page.legend({key: meaning for key, meaning in MEANINGS.items() if key in seen})


class TextPage:
    """Lines on one time axis: a label at the left, and beside it the spans."""

    def __init__(self, charts: list[Chart], width: int, blocks: dict[str, str]) -> None:
        self._width, self._blocks = width, blocks
        self._start = min(chart.start for chart in charts)
        self._end = max(chart.end for chart in charts)
        labels = [columns_of(printable(row.label)) for chart in charts for row in chart.rows]
        labels += [len(CENTRAL) for chart in charts if chart.restarts]
        self._label_width = min(max(labels, default=0), _WIDEST_LABEL, width // 2)
        self.columns = max(width - self._label_width - 2, 1)
        self._colours: dict[str, str] = {}

    def lines(self, label: str, lines: Iterable[Cells]) -> Iterator[str]:
        """Yield whole lines; the first begins with the label."""
        for cells in lines:
            yield f"{padded(label, self._label_width)}  {cells.line()}".rstrip()
            label = ""

    def axis(self, marks: Iterable[tuple[float, str]], *, is_below: bool = False) -> list[Cells]:
        """Return the lines of an axis: labels at their times, if they fit, and ticks."""
        labels, strokes = self._cells(), self._cells()
        occupied = -1
        for time, label in marks:
            at = min(labels.column(time), self.columns - 1)
            first = min(at, self.columns - len(label)) if is_below else at
            has_room = occupied < first <= self.columns - len(label)
            if has_room:
                labels.place(first, list(label), None)
                occupied = first + len(label)
            if has_room or is_below:
                strokes.place(at, [self._blocks[TICK]], None)
        return [strokes, labels] if is_below else [labels, strokes]

    def legend(self, meanings: Mapping[str, str]) -> Iterator[str]:
        """Yield the meanings of the characters, in lines that fit the page."""
        looks = {kind: character * 2 for kind, character in self._blocks.items()}
        looks |= {
            ending: self._blocks[BarKind.HANDLED] + mark for ending, (mark, _) in FAILURES.items()
        }
        looks |= {words: MARKS[ending][0] for ending, words in MARKED.items()}
        line = ""
        for word in (
            f"{looks[key]} {meaning}" for key, meaning in meanings.items() if key in looks
        ):
            if line and len(line) + 2 + len(word) > self._width:
                yield line
                line = ""
            line += ("  " if line else "") + cut(word, self._width)
        yield line

    def rows(self, chart: Chart) -> Iterator[str]:
        """Yield the lines of a chart's rows."""
        self._colours = dict(zip(chart.names, cycle(_COLOURS.split()), strict=False))
        for row in chart.rows:
            cells = self._handled(row, chart) + self._queued(row) + self._held(row)
            yield from self.lines(printable(row.label), cells + self._claims(row, chart))

    def restarts(self, chart: Chart) -> Iterator[str]:
        """Yield the line of the restarts of central, if there are any."""
        cells = self._cells()
        for one in chart.restarts:
            cells.paint(one.time, one.time, self._blocks[RESTART], "", "red")
        yield from self.lines(CENTRAL, [cells] * bool(chart.restarts))

    def _cells(self) -> Cells:
        return Cells(self._start, self._end, self.columns)

    def _handled(self, row: ResourceRow, chart: Chart) -> list[Cells]:
        lanes = [self._cells() for _ in range(min(row.lanes, _MOST_LANES))]
        for bar in row.handled:
            self._paint(lanes[min(bar.lane, _MOST_LANES - 1)], bar)
        for start, end in row.connected if row.is_idle else ():
            if chart.shows(start, end):
                lanes[0].paint(start, end, self._blocks[CONNECTED], "", "bright_black")
        return lanes

    def _queued(self, row: ResourceRow) -> list[Cells]:
        lanes = [self._cells() for _ in range(lanes_of(row.queued))]
        if len(lanes) > _MOST_QUEUE_LANES:  # its length, as numbers at the changes
            block = self._blocks[row.queued[0].kind]
            column = (self._end - self._start or 1.0) / self.columns
            for start, end, number in queue_lengths(row.queued, self._start, column):
                lanes[0].paint(start, end, block, str(number), None)
            return lanes[:1]
        for bar in row.queued:
            cells, block = lanes[bar.lane], self._blocks[bar.kind]
            cells.paint(bar.start, bar.end, block, bar.name, self._colours[bar.name])
            cells.add_marks(bar)
        return lanes

    def _held(self, row: ResourceRow) -> list[Cells]:
        """Return the lines of held tasks, with what each waits for."""
        more = lanes_of(row.held) - _MOST_QUEUE_LANES
        lanes = [self._cells() for _ in range(min(lanes_of(row.held), _MOST_QUEUE_LANES + 1))]
        for bar in row.held:
            if bar.lane < _MOST_QUEUE_LANES:
                cells = lanes[bar.lane]
                first, stop = cells.span(bar.start, bar.end)
                words, colour = bar.reason(stop - first - 4), self._colours[bar.name]
                cells.paint(bar.start, bar.end, self._blocks[BarKind.HELD], words, colour)
                if bar.lane_leader is not None:
                    cells.characters[first] = self._blocks[NEXT_CAUSE]
        if more > 0:
            lanes[-1].place(0, list(cut(f"and up to {more} more are held", self.columns)), None)
        return lanes

    def _claims(self, row: ResourceRow, chart: Chart) -> list[Cells]:
        cells = self._cells()
        claims = [claim for claim in row.claims if chart.shows(claim.start, claim.end)]
        for claim in claims:
            character = self._blocks[claim.kind]
            cells.paint(claim.start, claim.end, character, f"by {claim.name}", "red")
        return [cells] * bool(claims)

    def _paint(self, cells: Cells, bar: Bar) -> None:
        """Draw a bar with its waits, its ending and its marks."""
        blocks, colour = (
            self._blocks,
            self._colours.get(bar.name, "blue" if bar.early_span else None),
        )
        if bar.kind is BarKind.IDLE:
            cells.paint(bar.start, bar.end, blocks[bar.kind], bar.name, "bright_black")
            return
        first, stop = cells.span(bar.start, bar.end)
        line = [blocks[BarKind.HANDLED]] * (stop - first)
        if bar.early_span:
            count = max(min(cells.column(bar.early_span[1]) - first, len(line)), 1)
            line[:count] = [blocks[bar.early_style]] * count
        if len(line) == 1 and bar.is_waiting:
            line[0] = blocks[BarKind.WAITING]
        elif len(line) > 1 and not bar.is_open and bar.end <= cells.end:
            line[-1] = blocks[END]  # a gap before the next bar
        for wait in bar.waits:
            start = cells.column(wait.start) - first
            end = min(cells.column(wait.end) - first, len(line))
            line[max(start, 0) : max(end, 0)] = [blocks[BarKind.WAITING]] * (end - max(start, 0))
        write_name(line, *bar.labels)
        if bar.ending in FAILURES:
            line[-1], colour = FAILURES[bar.ending]
        cells.place(first, line, colour)
        cells.add_marks(bar)
