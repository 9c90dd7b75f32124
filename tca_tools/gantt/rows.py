"""Draws the rows of a chart: its band, its locks, its bars, what waits below them, and flags where something failed."""

from bisect import bisect_left
from collections.abc import Iterator
from itertools import chain
from operator import attrgetter, itemgetter

from tca_tools.drawing.svg import lines, rectangle, text
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.blocks import in_blocks, share_of
from tca_tools.gantt.chart import Bar, Chart, Ending, Row, lanes_of
from tca_tools.gantt.looks import CHARACTER, COLOURS, dark, light, row_label
from tca_tools.gantt.queues import MOST_QUEUE_LANES, QUEUE_LANE, curve, is_curve, queue_height
from tca_tools.terminal import columns_of
from tca_wire.text.measures import from_to
from tca_wire.text.printable import printable

_LANE = 24.0
_MOST_LANES = 12
_HELD_LANE, _MOST_HELD_LANES = 17.0, 6
"""Lanes of held tasks, which say why on their bars; of more the number is shown."""
_NARROW, _COLUMN = 1.5, 4.0
"""Pixels: of a bar that is not drawn alone if it has neighbours, and of the column in which those are put together."""
_SMALLEST = 1.0
_PALEST = 0.45
_STROKE = 2.5
_FRAMED = 6.0
"""Pixels: a narrower bar that failed gets no frame, and one that was killed no dark end."""
_FOOT = 5.0
"""Pixels: how high what they get is."""
_FLAG_WIDTH, _FLAG_HEIGHT, _FLAG_ABOVE = 8.0, 7.0, 10.0
_TOGETHER = 6.0
"""Pixels: failures that are no further from each other share a flag."""
_START = attrgetter("start")
_Failure = tuple[float, str]
"""When, and all there is to say about it."""


class Painter:
    """Draws rows, on one scale and in the colours of one chart."""

    def __init__(self, chart: Chart, scale: Scale) -> None:
        self._chart = chart
        self._numbers = {name: number for number, name in enumerate(chart.names)}
        self._scale = scale
        self._curves = {id(row) for row in chart.rows if is_curve(row, scale)}
        self._narrow, self._column = _NARROW * scale.pixel, _COLUMN * scale.pixel

    def height(self, row: Row) -> float:
        """How high a row is."""
        held = min(lanes_of(row.held), _MOST_HELD_LANES + 1) * _HELD_LANE
        return min(row.lanes, _MOST_LANES) * _LANE + self._queue_height(row) + held

    def _queue_height(self, row: Row) -> float:
        return queue_height(row, is_curve=id(row) in self._curves)

    def label(self, row: Row, right: float, top: float) -> str:
        """The row's name; of a long one the whole at the mouse."""
        y, name = top + min(_LANE, self.height(row)) / 2 + 4, row_label(row)
        whole = f"<title>{text(row.label)}</title>" if name != printable(row.label) else ""
        return f'<text class="label" x="{right:.1f}" y="{y:.1f}">{text(name)}{whole}</text>'

    def band(self, row: Row, top: float) -> Iterator[str]:
        """When its module was connected, and when somebody had the resource for himself."""
        scale, height = self._scale, self.height(row)
        for start, end in row.connected:
            if self._chart.shows(start, end):
                yield rectangle('class="connected"', scale.x(start), top - 3, scale.x(end), height + 6)
        for one in row.claims:
            if self._chart.shows(one.start, one.end):
                left, right = scale.x(one.start), max(scale.x(one.end), scale.x(one.start) + _SMALLEST)
                yield rectangle(f'class="{one.kind}"', left, top - 5, right, height + 10, one.title())
                free = row.handled[bisect_left(row.handled, one.start, key=_START) :][:1]
                room = min(right, scale.x(free[0].start)) if free else right
                yield from self._words(f"{one.kind} by {one.name}", "in", left, room, top + _LANE / 2 + 4)

    def bars(self, row: Row, top: float) -> Iterator[str]:
        """Its bars, what waits below them, and flags above."""
        for bar in self._in_blocks(row.handled):
            draw = self._block if bar.parts else self._handled
            yield from draw(bar, top + min(bar.lane, _MOST_LANES - 1) * _LANE)
        below = top + min(row.lanes, _MOST_LANES) * _LANE
        if id(row) in self._curves:
            yield from curve(row, self._scale, self._column, below)
        else:
            yield from self._queue(row.queued, below)
            yield from self._marks(row.queued, below, QUEUE_LANE, MOST_QUEUE_LANES)
        yield from self._marks(row.handled, top, _LANE, _MOST_LANES)
        yield from self._held(row, below + self._queue_height(row))
        yield from self._flags(row, top)

    def _in_blocks(self, bars: list[Bar]) -> Iterator[Bar]:
        """The shapes to draw: blocks first, below the others."""
        wide, blocks = in_blocks(bars, self._scale.start, self._column, self._narrow)
        return chain(blocks, wide)

    def _held(self, row: Row, top: float) -> Iterator[str]:
        """The held tasks, with what each waits for in words."""
        scale = self._scale
        for bar in self._in_blocks(row.held):
            if bar.lane < _MOST_HELD_LANES:
                left, y = scale.x(bar.start), top + bar.lane * _HELD_LANE + 1
                right, colour = max(scale.x(bar.end), left + scale.finest), dark(self._numbers[bar.name])
                look = f'fill="#ffffff" stroke="{colour}" stroke-width="1" stroke-dasharray="4 3"{_paled(bar)}'
                yield rectangle(look, left, y, right, _HELD_LANE - 3, bar.title())
                if words := bar.words(int((right - left - 8) / CHARACTER)):
                    yield from self._words(words, "in", left, right, y + _HELD_LANE - 6)
        if (more := lanes_of(row.held) - _MOST_HELD_LANES) > 0:
            y = top + (_MOST_HELD_LANES + 1) * _HELD_LANE - 5
            yield f'<text class="faint" x="3" y="{y:.1f}" pointer-events="none">and up to {more} more are held</text>'

    def _marks(self, bars: list[Bar], top: float, lane: float, most: int) -> Iterator[str]:
        """The moments at which failures were raised beside the handlers: strokes that are higher than the bar."""
        drawn: set[tuple[int, int]] = set()
        for bar in bars:
            for mark in filter(lambda one: self._chart.shows(one.time), bar.raised):
                x, number = self._scale.x(mark.time), min(bar.lane, most - 1)
                place = number, round(x / self._scale.finest)
                if place not in drawn:
                    drawn.add(place)
                    look, y = f'fill="{COLOURS[mark.ending]}"', top + number * lane
                    yield rectangle(look, x - _STROKE / 2, y - 1, x + _STROKE / 2, lane + 1, mark.title)

    def _queue(self, bars: list[Bar], top: float) -> Iterator[str]:
        for bar in self._in_blocks(bars):
            number = self._numbers[bar.name]
            look = f'fill="url(#{bar.kind}{number})" stroke="{dark(number)}" stroke-width="0.6"{_paled(bar)}'
            left, right = self._scale.x(bar.start), self._scale.x(bar.end)
            y = top + bar.lane * QUEUE_LANE + 1
            yield rectangle(look, left, y, max(right, left + self._scale.finest), QUEUE_LANE - 2, bar.title())

    def _block(self, block: Bar, top: float) -> Iterator[str]:
        left = self._scale.x(block.start)
        right = max(self._scale.x(block.end), left + self._scale.finest)
        colour = (light if block.is_waiting else dark)(self._numbers[block.name])
        shade = (_PALEST + (1 - _PALEST) * share_of(block)) * (0.4 if block.is_beside else 1.0)
        yield rectangle(f'fill="{colour}" fill-opacity="{shade:.2f}"', left, top + 2, right, _LANE - 4, block.title())
        yield from _ending(block, left, right, top + 2, self._scale.finest)

    def _handled(self, bar: Bar, top: float) -> Iterator[str]:
        scale, number, paled = self._scale, self._numbers[bar.name], _paled(bar)
        left, right = scale.x(bar.start), scale.x(bar.end)
        right = max(right, left + scale.finest)
        y, height = top + 2, _LANE - 4
        gap = 0.8 * scale.finest if right - left > 4 and not bar.is_open else 0.0  # to tell neighbours apart
        colour = light(number) if bar.is_waiting and right - left <= _SMALLEST * scale.finest else dark(number)
        seen = f' stroke="{colour}" stroke-width="0.8"' if right - left < _SMALLEST else ""
        yield rectangle(f'fill="{colour}"{seen}{paled}', left, y, right - gap, height, bar.title())
        waits = [(max(scale.x(wait.start), left), min(scale.x(wait.end), right), wait) for wait in bar.waits]
        for start, end, wait in waits:
            if end - start > _SMALLEST * scale.finest:
                look = f'fill="{light(number)}" stroke="{dark(number)}" stroke-width="0.6"{paled}'
                yield rectangle(look, start, y, end, height, wait.title())
        if bar.is_open and bar.end <= scale.end:
            colour = light(number) if waits and waits[-1][1] >= right else dark(number)
            yield f'<path fill="{colour}" d="M{right:.1f} {y:.1f} l7 {height / 2:.1f} l-7 {height / 2:.1f} z"/>'
        yield from _ending(bar, left, right, y, scale.finest, is_end_seen=bar.end <= scale.end)
        yield from self._bar_label(bar, left, right, [(start, end) for start, end, _ in waits], y + height / 2 + 4)

    def _bar_label(
        self, bar: Bar, left: float, right: float, waits: list[tuple[float, float]], y: float
    ) -> Iterator[str]:
        """The first label that has room in the widest part of the bar; or the last, if that will have room there."""
        edges = [left, *(edge for wait in sorted(waits) for edge in wait), right]
        parts = [(edges[i + 1] - edges[i], edges[i], i % 2) for i in range(len(edges) - 1)]
        width, start, is_light = max(parts)
        name = next((one for one in bar.labels if _wide(one) < width), bar.labels[-1])
        yield from self._words(name, "in" if is_light or bar.is_beside else "on", start, start + width, y)

    def _words(self, words: str, kind: str, left: float, right: float, y: float) -> Iterator[str]:
        """Words where they have room, or will have it."""
        depth = self._scale.depth_for(_wide(words), right - left)
        if depth:
            kind += "" if depth == 1 else f" z{depth}"
            x = left + 4 / depth
            until = f' data-to="{right:.2f}"' if len(self._scale.depths) > 1 else ""  # a page keeps it in sight
            yield f'<text class="{kind}" x="{x:.2f}" y="{y:.1f}"{until} pointer-events="none">{text(words)}</text>'

    def _flags(self, row: Row, top: float) -> Iterator[str]:
        """Flags where something failed, for its bar may be too narrow to be seen: red ones over amber ones."""
        for ending in (Ending.COPED, Ending.FAILED):
            found = [(bar.end, bar.title()) for bar in row.handled if bar.ending is ending]
            found += [(one.time, one.title) for bar in row.bars for one in bar.raised if one.ending is ending]
            seen = sorted((one for one in found if self._chart.shows(one[0])), key=itemgetter(0))
            for some in _together(seen, _TOGETHER * self._scale.pixel):
                (first, title), (last, _) = some[0], some[-1]
                x, y = self._scale.x((first + last) / 2), top - _FLAG_ABOVE
                count = f"{len(some)} failures {from_to(first, last)}, first: " * (len(some) > 1)
                yield (
                    f'<path class="flag" fill="{COLOURS[ending]}" d="M{x - _FLAG_WIDTH / 2:.2f} {y:.1f} '
                    f'h{_FLAG_WIDTH:.0f} l{-_FLAG_WIDTH / 2:.0f} {_FLAG_HEIGHT:.0f} z">'
                    f"<title>{lines(count + title)}</title></path>"
                )


def _wide(words: str) -> float:
    """How much room words need."""
    return columns_of(words) * CHARACTER + 6


def _ending(
    bar: Bar, left: float, right: float, top: float, finest: float, *, is_end_seen: bool = True
) -> Iterator[str]:
    """A frame around what failed, a dark end of what was killed; where that would hide all that is in it, a foot."""
    if not bar.ending or (bar.ending is Ending.KILLED and not is_end_seen):
        return
    bottom = top + _LANE - 4
    if right - left <= _FRAMED:
        wide = max(right, left + 1.5 * finest)
        yield rectangle(f'fill="{COLOURS[bar.ending]}"', left, bottom - _FOOT, wide, _FOOT)
    elif bar.ending is Ending.KILLED:
        x = right - 1.5 * finest
        yield f'<line class="killed" x1="{x:.2f}" y1="{top:.1f}" x2="{x:.2f}" y2="{bottom:.1f}"/>'
    else:
        yield rectangle(f'class="{bar.ending}"', left, top, right, _LANE - 4)


def _together(failures: list[_Failure], apart: float) -> Iterator[list[_Failure]]:
    """Those that are no further than that from the first of them."""
    some: list[_Failure] = []
    for one in failures:
        if some and one[0] - some[0][0] > apart:
            yield some
            some = []
        some.append(one)
    if some:
        yield some


def _paled(bar: Bar) -> str:
    return ' class="beside"' if bar.is_beside else ""
