"""Draws the rows of a chart: its band, its locks, its bars, what waits below them, and flags where something failed."""

from bisect import bisect_left
from collections.abc import Iterator
from itertools import chain
from operator import attrgetter, itemgetter

from tca_tools.drawing.svg import lines, rectangle, text
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.blocks import in_blocks, share_of
from tca_tools.gantt.chart import Bar, Chart, Ending, ResourceRow, lanes_of
from tca_tools.gantt.looks import CHARACTER, COLOURS, dark, light, row_label
from tca_tools.gantt.queues import MOST_QUEUE_LANES, QUEUE_LANE, curve, is_curve, queue_height
from tca_tools.terminal import columns_of
from tca_wire.text.measures import from_to
from tca_wire.text.printable import printable

_LANE = 24.0
_BAR = _LANE - 4
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
_STRIP = 5.5
"""Pixels: how high the mark of what ran ahead of its state is."""
_FLAG_WIDTH, _FLAG_HEIGHT, _FLAG_ABOVE = 8.0, 7.0, 10.0
_TOGETHER = 6.0
"""Pixels: failures that are no further from each other share a flag."""
_START = attrgetter("start")


class Painter:
    """Draws rows, on one scale and in the colours of one chart."""

    def __init__(self, chart: Chart, scale: Scale) -> None:
        self._chart = chart
        self._numbers = {name: number for number, name in enumerate(chart.names)}
        self._scale = scale
        self._curves = {id(row) for row in chart.rows if is_curve(row, scale)}

    def height(self, row: ResourceRow) -> float:
        """How high a row is."""
        held = min(lanes_of(row.held), _MOST_HELD_LANES + 1) * _HELD_LANE
        return min(row.lanes, _MOST_LANES) * _LANE + queue_height(row, is_curve=id(row) in self._curves) + held

    def label(self, row: ResourceRow, right: float, top: float) -> str:
        """The row's name; of a long one the whole at the mouse."""
        y, name = top + min(_LANE, self.height(row)) / 2 + 4, row_label(row)
        whole = f"<title>{text(row.label)}</title>" if name != printable(row.label) else ""
        return f'<text class="label" x="{right:.1f}" y="{y:.1f}">{text(name)}{whole}</text>'

    def band(self, row: ResourceRow, top: float) -> Iterator[str]:
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

    def bars(self, row: ResourceRow, top: float) -> Iterator[str]:
        """Its bars, what waits below them, and flags above."""
        for bar in self._in_blocks(row.handled):
            y = top + min(bar.lane, _MOST_LANES - 1) * _LANE + 2
            yield from self._block(bar, y) if bar.parts else self._handled(bar, y)
        below = top + min(row.lanes, _MOST_LANES) * _LANE
        if id(row) in self._curves:
            yield from curve(row, self._scale, _COLUMN * self._scale.pixel, below)
        else:
            yield from self._queue(row.queued, below)
            yield from self._marks(row.queued, below, QUEUE_LANE, MOST_QUEUE_LANES)
        yield from self._marks(row.handled, top, _LANE, _MOST_LANES)
        yield from self._held(row, below + queue_height(row, is_curve=id(row) in self._curves))
        yield from self._flags(row, top)

    def _in_blocks(self, bars: list[Bar]) -> Iterator[Bar]:
        """The shapes to draw: blocks first, below the others."""
        pixel = self._scale.pixel
        wide, blocks = in_blocks(bars, self._scale.start, _COLUMN * pixel, _NARROW * pixel)
        return chain(blocks, wide)

    def _ends(self, bar: Bar) -> tuple[float, float]:
        """Where a bar begins and ends; it is never too narrow to be seen."""
        left = self._scale.x(bar.start)
        return left, max(self._scale.x(bar.end), left + self._scale.finest)

    def _held(self, row: ResourceRow, top: float) -> Iterator[str]:
        """The held tasks, with what each waits for in words."""
        for bar in self._in_blocks(row.held):
            if bar.lane < _MOST_HELD_LANES:
                (left, right), y = self._ends(bar), top + bar.lane * _HELD_LANE + 1
                look = (
                    f'fill="#ffffff" stroke="{dark(self._numbers[bar.name])}" stroke-width="1" stroke-dasharray="4 3"'
                )
                yield rectangle(look + _paled(bar), left, y, right, _HELD_LANE - 3, bar.title())
                if words := bar.words(int((right - left - 8) / CHARACTER)):
                    yield from self._words(words, "in", left, right, y + _HELD_LANE - 6)
        if (more := lanes_of(row.held) - _MOST_HELD_LANES) > 0:
            y = top + (_MOST_HELD_LANES + 1) * _HELD_LANE - 5
            yield f'<text class="faint" x="3" y="{y:.1f}" pointer-events="none">and up to {more} more are held</text>'

    def _marks(self, bars: list[Bar], top: float, lane: float, most: int) -> Iterator[str]:
        """The marks of bars: strokes that are higher than these."""
        drawn: set[tuple[int, int]] = set()
        for bar in bars:
            for mark in filter(lambda one: self._chart.shows(one.time), bar.marks):
                x, number = self._scale.x(mark.time), min(bar.lane, most - 1)
                place = number, round(x / self._scale.finest)
                if place not in drawn:
                    drawn.add(place)
                    look, y = f'fill="{COLOURS[mark.ending]}"', top + number * lane
                    yield rectangle(look, x - _STROKE / 2, y - 1, x + _STROKE / 2, lane + 1, mark.title)

    def _queue(self, bars: list[Bar], top: float) -> Iterator[str]:
        for bar in self._in_blocks(bars):
            number, (left, right) = self._numbers[bar.name], self._ends(bar)
            look = f'fill="url(#{bar.kind}{number})" stroke="{dark(number)}" stroke-width="0.6"{_paled(bar)}'
            yield rectangle(look, left, top + bar.lane * QUEUE_LANE + 1, right, QUEUE_LANE - 2, bar.title())

    def _block(self, block: Bar, y: float) -> Iterator[str]:
        left, right = self._ends(block)
        colour = (light if block.is_waiting else dark)(self._numbers[block.name])
        shade = (_PALEST + (1 - _PALEST) * share_of(block)) * (0.4 if block.is_beside else 1.0)
        yield rectangle(f'fill="{colour}" fill-opacity="{shade:.2f}"', left, y, right, _BAR, block.title())
        yield from self._ending(block, left, right, y)

    def _handled(self, bar: Bar, y: float) -> Iterator[str]:
        scale, (left, right), paled = self._scale, self._ends(bar), _paled(bar)
        strong, pale = (shade(self._numbers[bar.name]) for shade in (dark, light))
        gap = 0.8 * scale.finest if right - left > 4 and not bar.is_open else 0.0  # to tell neighbours apart
        colour = pale if bar.is_waiting and right - left <= _SMALLEST * scale.finest else strong
        seen = f' stroke="{colour}" stroke-width="0.8"' if right - left < _SMALLEST else ""
        yield rectangle(f'fill="{colour}"{seen}{paled}', left, y, right - gap, _BAR, bar.title())
        waits = [(max(scale.x(wait.start), left), min(scale.x(wait.end), right)) for wait in bar.waits]
        for (start, end), wait in zip(waits, bar.waits, strict=True):
            if end - start > _SMALLEST * scale.finest:
                look = f'fill="{pale}" stroke="{strong}" stroke-width="0.6"{paled}'
                yield rectangle(look, start, y, end, _BAR, wait.title())
        if bar.ahead:
            until = min(max(scale.x(bar.ahead[1]), left + scale.finest), right)
            yield rectangle(f'class="{bar.preview}" pointer-events="none"', left, y, until, _STRIP)
        if bar.is_open and bar.end <= scale.end:
            colour = pale if waits and waits[-1][1] >= right else strong
            yield f'<path fill="{colour}" d="M{right:.1f} {y:.1f} l7 {_BAR / 2:.1f} l-7 {_BAR / 2:.1f} z"/>'
        if bar.ending is not Ending.KILLED or bar.end <= scale.end:
            yield from self._ending(bar, left, right, y)
        # the first label that has room in the widest part of the bar; or the last, if that will have room there
        edges = [left, *chain.from_iterable(sorted(waits)), right]
        width, start, is_light = max((edges[i + 1] - edges[i], edges[i], i % 2) for i in range(len(edges) - 1))
        name = next((one for one in bar.labels if _wide(one) < width), "".join(bar.labels[-1:]))
        kind = "in" if is_light or bar.is_beside else "on"
        yield from self._words(name, kind, start, start + width, y + _BAR / 2 + 4)

    def _ending(self, bar: Bar, left: float, right: float, y: float) -> Iterator[str]:
        """A frame around what failed, a dark end of what was killed; a foot of what is too narrow for that."""
        thin = 1.5 * self._scale.finest
        if bar.ending and right - left <= _FRAMED:
            yield rectangle(f'fill="{COLOURS[bar.ending]}"', left, y + _BAR - _FOOT, max(right, left + thin), _FOOT)
        elif bar.ending is Ending.KILLED:
            x = right - thin
            yield f'<line class="killed" x1="{x:.2f}" y1="{y:.1f}" x2="{x:.2f}" y2="{y + _BAR:.1f}"/>'
        elif bar.ending:
            yield rectangle(f'class="{bar.ending}"', left, y, right, _BAR)

    def _words(self, words: str, kind: str, left: float, right: float, y: float) -> Iterator[str]:
        """Words where they have room, or will have it."""
        depth = self._scale.depth_for(_wide(words), right - left)
        if depth:
            kind += "" if depth == 1 else f" z{depth}"
            x = left + 4 / depth
            until = f' data-to="{right:.2f}"' if len(self._scale.depths) > 1 else ""  # a page keeps it in sight
            yield f'<text class="{kind}" x="{x:.2f}" y="{y:.1f}"{until} pointer-events="none">{text(words)}</text>'

    def _flags(self, row: ResourceRow, top: float) -> Iterator[str]:
        """Flags where something failed, for its bar may be too narrow to be seen: red ones over others."""
        for ending in (Ending.RESOLVED, Ending.COPED, Ending.FAILED):
            found = [(bar.end, bar.title()) for bar in row.handled if bar.ending is ending]
            found += [(one.time, one.title) for bar in row.bars for one in bar.marks if one.ending is ending]
            flags: list[list[tuple[float, str]]] = []
            for one in sorted((one for one in found if self._chart.shows(one[0])), key=itemgetter(0)):
                if flags and one[0] - flags[-1][0][0] <= _TOGETHER * self._scale.pixel:
                    flags[-1].append(one)
                else:
                    flags.append([one])
            for some in flags:
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


def _paled(bar: Bar) -> str:
    return ' class="beside"' if bar.is_beside else ""
