"""Draws the rows of a chart: its band, its locks, its bars, what waits below them, and flags where
something failed.
"""

from bisect import bisect_left
from collections.abc import Iterator
from itertools import chain, pairwise
from operator import attrgetter, itemgetter

from tca_tools.drawing.svg import UNTOUCHED, line, lines, rectangle, text, words
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.blocks import in_blocks, share_of
from tca_tools.gantt.chart import FLAGGED, MARKED, Bar, Chart, Ending, ResourceRow, lanes_of
from tca_tools.gantt.looks import CHARACTER, dark, light, row_label
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
"""Pixels: of a bar that is not drawn alone if it has neighbours, and of the column in which those
are put together.
"""
_SMALLEST = 1.0
_PALEST = 0.45
_STROKE = 2.5
_FRAMED = 6.0
"""Pixels: a narrower bar that failed gets no frame, and one that was killed no dark end."""
_FOOT = 5.0
"""Pixels: how high what they get is."""
_STRIP = 5.5
"""Pixels: how high the mark of what ran ahead of its state is."""
_FLAG_ABOVE = 10.0
_TOGETHER = 6.0
"""Pixels: failures that are no further from each other share a flag."""
_START = attrgetter("start")
_CONNECTED = 'class="connected"'


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
        return min(row.lanes, _MOST_LANES) * _LANE + self._queue_height(row) + held

    def label(self, row: ResourceRow, right: float, top: float) -> str:
        """The row's name; of a long one the whole at the mouse."""
        y, name = top + min(_LANE, self.height(row)) / 2 + 4, row_label(row)
        whole = f"<title>{text(row.label)}</title>" if name != printable(row.label) else ""
        return f'<text class="label" x="{right:.1f}" y="{y:.1f}">{text(name)}{whole}</text>'

    def band(self, row: ResourceRow, top: float) -> Iterator[str]:
        """When its module was connected, and when somebody had the resource for himself."""
        x, height = self._scale.x, self.height(row)
        for start, end in row.connected:
            if self._chart.shows(start, end):
                yield rectangle(_CONNECTED, x(start), top - 3, x(end), height + 6)
        for one in row.claims:
            if self._chart.shows(one.start, one.end):
                left, look = x(one.start), f'class="{one.kind}"'
                right = max(x(one.end), left + _SMALLEST)
                yield rectangle(look, left, top - 5, right, height + 10, one.title())
                free = row.handled[bisect_left(row.handled, one.start, key=_START) :]
                room = min([right, *(x(bar.start) for bar in free[:1])])
                owner = f"{one.kind} by {one.name}"
                yield from self._words(owner, "in", (left, room), top + _LANE / 2 + 4)

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
        yield from self._held(row, below + self._queue_height(row))
        for ending in reversed(FLAGGED):  # red flags lie over others
            yield from self._flags(row, ending, top - _FLAG_ABOVE)

    def _queue_height(self, row: ResourceRow) -> float:
        return queue_height(row, is_curve=id(row) in self._curves)

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
                look = f'fill="#ffffff" stroke="{dark(self._numbers[bar.name])}" stroke-width="1" '
                look += f'stroke-dasharray="4 3"{_paled(bar)}'
                yield rectangle(look, left, y, right, _HELD_LANE - 3, bar.title())
                if why := bar.words(int((right - left - 8) / CHARACTER)):
                    yield from self._words(why, "in", (left, right), y + _HELD_LANE - 6)
        if (more := lanes_of(row.held) - _MOST_HELD_LANES) > 0:
            y = top + (_MOST_HELD_LANES + 1) * _HELD_LANE - 5
            yield words("faint", 3, y, f"and up to {more} more are held", UNTOUCHED)

    def _marks(self, bars: list[Bar], top: float, lane: float, most: int) -> Iterator[str]:
        """The marks of bars: strokes that are higher than these."""
        drawn: set[tuple[int, int]] = set()
        for bar in bars:
            for mark in filter(lambda one: self._chart.shows(one.time), bar.marks):
                x, number = self._scale.x(mark.time), min(bar.lane, most - 1)
                place = number, round(x / self._scale.finest)
                if place not in drawn:
                    drawn.add(place)
                    look, y, left = (
                        f'class="{MARKED[mark.ending]}"',
                        top + number * lane,
                        x - _STROKE / 2,
                    )
                    yield rectangle(look, left, y - 1, left + _STROKE, lane + 1, mark.title)

    def _queue(self, bars: list[Bar], top: float) -> Iterator[str]:
        for bar in self._in_blocks(bars):
            number, (left, right) = self._numbers[bar.name], self._ends(bar)
            look = f'fill="url(#{bar.kind}{number})" stroke="{dark(number)}" stroke-width="0.6"{_paled(bar)}'
            y = top + bar.lane * QUEUE_LANE + 1
            yield rectangle(look, left, y, right, QUEUE_LANE - 2, bar.title())

    def _block(self, block: Bar, y: float) -> Iterator[str]:
        left, right = self._ends(block)
        colour = (light if block.is_waiting else dark)(self._numbers[block.name])
        shade = _PALEST + (1 - _PALEST) * share_of(block)
        if block.is_beside:
            shade *= 0.4
        look = f'fill="{colour}" fill-opacity="{shade:.2f}"'
        yield rectangle(look, left, y, right, _BAR, block.title())
        yield from self._ending(block, left, right, y)

    def _handled(self, bar: Bar, y: float) -> Iterator[str]:
        scale, (left, right), paled = self._scale, self._ends(bar), _paled(bar)
        strong, pale = (shade(self._numbers[bar.name]) for shade in (dark, light))
        gap = (
            0.8 * scale.finest if right - left > 4 and not bar.is_open else 0.0
        )  # to tell neighbours apart
        smallest = _SMALLEST * scale.finest
        colour = pale if bar.is_waiting and right - left <= smallest else strong
        look = f'fill="{colour}"'
        if right - left < _SMALLEST:
            look += f' stroke="{colour}" stroke-width="0.8"'
        yield rectangle(look + paled, left, y, right - gap, _BAR, bar.title())
        waits = [
            (max(scale.x(wait.start), left), min(scale.x(wait.end), right)) for wait in bar.waits
        ]
        for (start, end), wait in zip(waits, bar.waits, strict=True):
            if end - start > smallest:
                look = f'fill="{pale}" stroke="{strong}" stroke-width="0.6"{paled}'
                yield rectangle(look, start, y, end, _BAR, wait.title())
        if bar.ahead:
            until = min(max(scale.x(bar.ahead[1]), left + scale.finest), right)
            yield rectangle(f'class="{bar.preview}"' + UNTOUCHED, left, y, until, _STRIP)
        if bar.is_open and bar.end <= scale.end:
            colour = pale if waits and waits[-1][1] >= right else strong
            yield f'<path fill="{colour}" d="M{right:.1f} {y:.1f} l7 {_BAR / 2:.1f} l-7 {_BAR / 2:.1f} z"/>'
        if bar.ending is not Ending.KILLED or bar.end <= scale.end:
            yield from self._ending(bar, left, right, y)
        yield from self._name(bar, [left, *chain.from_iterable(sorted(waits)), right], y)

    def _name(self, bar: Bar, edges: list[float], y: float) -> Iterator[str]:
        """The first label that has room in the widest part of the bar; or the last, if that will
        have room there.
        """
        parts = enumerate(pairwise(edges))
        width, start, is_light = max((b - a, a, number % 2) for number, (a, b) in parts)
        fitting = [one for one in bar.labels if _wide(one) < width]
        name = (fitting or [*bar.labels[-1:], ""])[0]
        kind = "in" if is_light or bar.is_beside else "on"
        yield from self._words(name, kind, (start, start + width), y + _BAR / 2 + 4)

    def _ending(self, bar: Bar, left: float, right: float, y: float) -> Iterator[str]:
        """A frame around what failed, a dark end of what was killed; a foot of what is too narrow
        for that.
        """
        thin = 1.5 * self._scale.finest
        if bar.ending and right - left <= _FRAMED:
            look, top = f'class="ink-{bar.ending}"', y + _BAR - _FOOT
            yield rectangle(look, left, top, max(right, left + thin), _FOOT)
        elif bar.ending is Ending.KILLED:
            x = right - thin
            yield line("end", x, y, x, y + _BAR)
        elif bar.ending:
            yield rectangle(f'class="{bar.ending}"', left, y, right, _BAR)

    def _words(self, said: str, kind: str, span: tuple[float, float], y: float) -> Iterator[str]:
        """Words where they have room, or will have it."""
        left, right = span
        if depth := self._scale.depth_for(_wide(said), right - left):
            kind += "" if depth == 1 else f" z{depth}"
            until = (
                f' data-to="{right:.2f}"' if len(self._scale.depths) > 1 else ""
            )  # a page keeps it in sight
            yield words(kind, left + 4 / depth, y, said, until + UNTOUCHED)

    def _flags(self, row: ResourceRow, ending: Ending, y: float) -> Iterator[str]:
        """Flags where something failed, for its bar may be too narrow to be seen."""
        found = [(bar.end, bar.title()) for bar in row.handled if bar.ending is ending]
        marks = [mark for bar in row.bars for mark in bar.marks]
        found += [(one.time, one.title) for one in marks if one.ending is ending]
        flags: list[list[tuple[float, str]]] = []
        shown = [one for one in found if self._chart.shows(one[0])]
        for one in sorted(shown, key=itemgetter(0)):
            if flags and one[0] - flags[-1][0][0] <= _TOGETHER * self._scale.pixel:
                flags[-1].append(one)
            else:
                flags.append([one])
        for some in flags:
            (first, title), (last, _) = some[0], some[-1]
            if len(some) > 1:
                title = f"{len(some)} failures {from_to(first, last)}, first: {title}"
            x = self._scale.x((first + last) / 2)
            look = f'class="flag ink-{ending}" d="M{x - 4:.2f} {y:.1f} h8 l-4 7 z"'
            yield f"<path {look}><title>{lines(title)}</title></path>"


def _wide(said: str) -> float:
    """How much room words need."""
    return columns_of(said) * CHARACTER + 6


def _paled(bar: Bar) -> str:
    return ' class="beside"' if bar.is_beside else ""
