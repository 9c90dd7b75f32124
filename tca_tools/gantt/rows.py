"""Draw the rows of a chart: band, locks, bars, the queue below them, and flags at failures."""

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
"""The height of a lane of held tasks, and the most lanes; for more, their number is shown."""
_NARROW, _COLUMN = 1.5, 4.0
"""Pixels: the width below which a bar joins a block, and the width of a block's column."""
_SMALLEST = 1.0
_PALEST = 0.45
_STROKE = 2.5
_FRAMED = 6.0
"""Pixels: a bar must be wider to get the frame of a failure, or the dark end of a kill."""
_FOOT = 5.0
"""Pixels: the height of the foot that a narrower bar gets instead."""
_STRIP = 5.5
"""Pixels: the height of the strip that marks early work."""
_FLAG_ABOVE = 10.0
_TOGETHER = 6.0
"""Pixels: failures within this distance share a flag."""
_START = attrgetter("start")
_CONNECTED = 'class="connected"'


class Painter:
    """Draws the rows of a chart on a scale."""

    def __init__(self, chart: Chart, scale: Scale) -> None:
        self._chart = chart
        self._numbers = {name: number for number, name in enumerate(chart.names)}
        self._scale = scale
        self._curves = {id(row) for row in chart.rows if is_curve(row, scale)}

    def height(self, row: ResourceRow) -> float:
        """Return the height of a row."""
        held = min(lanes_of(row.held), _MOST_HELD_LANES + 1) * _HELD_LANE
        return min(row.lanes, _MOST_LANES) * _LANE + self._queue_height(row) + held

    def label(self, row: ResourceRow, right: float, top: float) -> str:
        """Draw the row's name. If the name is shortened, its title has the whole name."""
        y, name = top + min(_LANE, self.height(row)) / 2 + 4, row_label(row)
        whole = f"<title>{text(row.label)}</title>" if name != printable(row.label) else ""
        return f'<text class="label" x="{right:.1f}" y="{y:.1f}">{text(name)}{whole}</text>'

    def band(self, row: ResourceRow, top: float) -> Iterator[str]:
        """Draw the spans in which the module was connected, and the locks and reservations."""
        x, height = self._scale.x, self.height(row)
        for start, end in row.connected:
            if self._chart.shows(start, end):
                yield rectangle(_CONNECTED, x(start), top - 3, x(end), height + 6)
        for claim in row.claims:
            if self._chart.shows(claim.start, claim.end):
                left, look = x(claim.start), f'class="{claim.kind}"'
                right = max(x(claim.end), left + _SMALLEST)
                yield rectangle(look, left, top - 5, right, height + 10, claim.title())
                free = row.handled[bisect_left(row.handled, claim.start, key=_START) :]
                room = min([right, *(x(bar.start) for bar in free[:1])])
                owner = f"{claim.kind} by {claim.name}"
                yield from self._words(owner, "in", (left, room), top + _LANE / 2 + 4)

    def bars(self, row: ResourceRow, top: float) -> Iterator[str]:
        """Draw the bars of a row, the queue below them, and the flags above."""
        for bar in self._in_blocks(row.handled):
            y = top + min(bar.lane, _MOST_LANES - 1) * _LANE + 2
            yield from self._block(bar, y) if bar.parts else self._handled(bar, y)
        below = top + min(row.lanes, _MOST_LANES) * _LANE
        if id(row) in self._curves:
            yield from curve(row, self._scale, _COLUMN * self._scale.min_time, below)
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
        """Return the shapes to draw, blocks first so that they lie below the others."""
        pixel = self._scale.min_time
        wide, blocks = in_blocks(bars, self._scale.start, _COLUMN * pixel, _NARROW * pixel)
        return chain(blocks, wide)

    def _ends(self, bar: Bar) -> tuple[float, float]:
        """Return the left and right edge of a bar. They differ by at least the visible width."""
        left = self._scale.x(bar.start)
        return left, max(self._scale.x(bar.end), left + self._scale.min_width)

    def _held(self, row: ResourceRow, top: float) -> Iterator[str]:
        """Draw the held tasks, with what each waits for in words."""
        for bar in self._in_blocks(row.held):
            if bar.lane < _MOST_HELD_LANES:
                (left, right), y = self._ends(bar), top + bar.lane * _HELD_LANE + 1
                look = f'fill="#ffffff" stroke="{dark(self._numbers[bar.name])}" stroke-width="1" '
                look += f'stroke-dasharray="4 3"{_paleness(bar)}'
                yield rectangle(look, left, y, right, _HELD_LANE - 3, bar.title())
                if why := bar.reason(int((right - left - 8) / CHARACTER)):
                    yield from self._words(why, "in", (left, right), y + _HELD_LANE - 6)
        if (more := lanes_of(row.held) - _MOST_HELD_LANES) > 0:
            y = top + (_MOST_HELD_LANES + 1) * _HELD_LANE - 5
            yield words("faint", 3, y, f"and up to {more} more are held", UNTOUCHED)

    def _marks(self, bars: list[Bar], top: float, lane: float, most: int) -> Iterator[str]:
        """Draw the marks of bars: strokes that are a little higher than the bars."""
        drawn: set[tuple[int, int]] = set()
        for bar in bars:
            for mark in filter(lambda one: self._chart.shows(one.time), bar.marks):
                x, number = self._scale.x(mark.time), min(bar.lane, most - 1)
                place = number, round(x / self._scale.min_width)
                if place not in drawn:  # another mark at the same pixel would hide it
                    drawn.add(place)
                    look, left = f'class="{MARKED[mark.ending]}"', x - _STROKE / 2
                    y = top + number * lane - 1
                    yield rectangle(look, left, y, left + _STROKE, lane + 1, mark.title)

    def _queue(self, bars: list[Bar], top: float) -> Iterator[str]:
        for bar in self._in_blocks(bars):
            number, (left, right) = self._numbers[bar.name], self._ends(bar)
            look = f'fill="url(#{bar.kind}{number})" stroke="{dark(number)}" '
            look += f'stroke-width="0.6"{_paleness(bar)}'
            y = top + bar.lane * QUEUE_LANE + 1
            yield rectangle(look, left, y, right, QUEUE_LANE - 2, bar.title())

    def _block(self, block: Bar, y: float) -> Iterator[str]:
        left, right = self._ends(block)
        colour = (light if block.is_waiting else dark)(self._numbers[block.name])
        shade = _PALEST + (1 - _PALEST) * share_of(block)
        if block.is_unselected:
            shade *= 0.4
        look = f'fill="{colour}" fill-opacity="{shade:.2f}"'
        yield rectangle(look, left, y, right, _BAR, block.title())
        yield from self._ending(block, left, right, y)

    def _handled(self, bar: Bar, y: float) -> Iterator[str]:
        scale, (left, right), paled = self._scale, self._ends(bar), _paleness(bar)
        strong, pale = (shade(self._numbers[bar.name]) for shade in (dark, light))
        # A gap separates neighbours.
        gap = 0.8 * scale.min_width if right - left > 4 and not bar.is_open else 0.0
        smallest = _SMALLEST * scale.min_width
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
        if bar.early_span:
            until = min(max(scale.x(bar.early_span[1]), left + scale.min_width), right)
            yield rectangle(f'class="{bar.early_style}"' + UNTOUCHED, left, y, until, _STRIP)
        if bar.is_open and bar.end <= scale.end:
            colour = pale if waits and waits[-1][1] >= right else strong
            half = f"{_BAR / 2:.1f}"
            yield f'<path fill="{colour}" d="M{right:.1f} {y:.1f} l7 {half} l-7 {half} z"/>'
        if bar.ending is not Ending.KILLED or bar.end <= scale.end:
            yield from self._ending(bar, left, right, y)
        yield from self._name(bar, [left, *chain.from_iterable(sorted(waits)), right], y)

    def _name(self, bar: Bar, edges: list[float], y: float) -> Iterator[str]:
        """Write the first label that fits into the widest part of the bar.

        If none fits, write the last one, which shows when the plot is zoomed.
        """
        parts = enumerate(pairwise(edges))
        width, start, is_light = max((b - a, a, number % 2) for number, (a, b) in parts)
        fitting = [label for label in bar.labels if _text_width(label) < width]
        name = (fitting or [*bar.labels[-1:], ""])[0]
        kind = "in" if is_light or bar.is_unselected else "on"
        yield from self._words(name, kind, (start, start + width), y + _BAR / 2 + 4)

    def _ending(self, bar: Bar, left: float, right: float, y: float) -> Iterator[str]:
        """Draw a frame around a failed bar, or a dark end on a killed one.

        A narrow bar gets a foot instead.
        """
        thin = 1.5 * self._scale.min_width
        if bar.ending and right - left <= _FRAMED:
            look, top = f'class="ink-{bar.ending}"', y + _BAR - _FOOT
            yield rectangle(look, left, top, max(right, left + thin), _FOOT)
        elif bar.ending is Ending.KILLED:
            x = right - thin
            yield line("end", x, y, x, y + _BAR)
        elif bar.ending:
            yield rectangle(f'class="{bar.ending}"', left, y, right, _BAR)

    def _words(self, label: str, kind: str, span: tuple[float, float], y: float) -> Iterator[str]:
        """Write words if they fit into a span, now or when the plot is zoomed."""
        left, right = span
        if zoom := self._scale.zoom_for(_text_width(label), right - left):
            kind += "" if zoom == 1 else f" z{zoom}"
            # A page that scrolls keeps the words in sight, up to the end of their span.
            until = f' data-to="{right:.2f}"' if len(self._scale.zooms) > 1 else ""
            yield words(kind, left + 4 / zoom, y, label, until + UNTOUCHED)

    def _flags(self, row: ResourceRow, ending: Ending, y: float) -> Iterator[str]:
        """Draw flags at failures, whose bars may be too narrow to be noticed."""
        failures = [(bar.end, bar.title()) for bar in row.handled if bar.ending is ending]
        marks = [mark for bar in row.bars for mark in bar.marks]
        failures += [(mark.time, mark.title) for mark in marks if mark.ending is ending]
        flags: list[list[tuple[float, str]]] = []
        shown = [failure for failure in failures if self._chart.shows(failure[0])]
        for failure in sorted(shown, key=itemgetter(0)):
            if flags and failure[0] - flags[-1][0][0] <= _TOGETHER * self._scale.min_time:
                flags[-1].append(failure)
            else:
                flags.append([failure])
        for group in flags:
            (first, title), (last, _) = group[0], group[-1]
            if len(group) > 1:
                title = f"{len(group)} failures {from_to(first, last)}, first: {title}"
            x = self._scale.x((first + last) / 2)
            look = f'class="flag ink-{ending}" d="M{x - 4:.2f} {y:.1f} h8 l-4 7 z"'
            yield f"<path {look}><title>{lines(title)}</title></path>"


def _text_width(label: str) -> float:
    """Return the width that a label needs, in pixels."""
    return columns_of(label) * CHARACTER + 6


def _paleness(bar: Bar) -> str:
    return ' class="beside"' if bar.is_unselected else ""
