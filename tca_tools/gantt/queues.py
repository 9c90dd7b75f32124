"""Draw the queue below a row's bars: as hatched bars, or as a curve of its length.

It is a curve if the bars would be too many or too narrow.
"""

from collections.abc import Iterator

from tca_tools.drawing.svg import UNTOUCHED, rectangle, width_of, words
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.blocks import queue_lengths
from tca_tools.gantt.chart import ResourceRow, lanes_of
from tca_wire.text.measures import from_to

QUEUE_LANE = 9.0
MOST_QUEUE_LANES, _MOST_WITHOUT_MODULE = 6, 3
"""The most lanes of a queue that is drawn as bars; a row without a module has fewer."""
_HIGHEST, _LOWEST = 30.0, 16.0
"""Pixels: the height of a curve, with room for its number."""
_HATCHED = 14.0
"""Pixels: the least width of a bar whose hatching is visible."""
_BESIDE = 6.0
_CURVE = 'class="curve"'


def is_curve(row: ResourceRow, scale: Scale) -> bool:
    """Whether only the length of the queue is drawn: it is long, or its bars are mostly narrow."""
    if lanes_of(row.queued) > (_MOST_WITHOUT_MODULE if row.is_without_module else MOST_QUEUE_LANES):
        return True
    widths = [scale.x(bar.end) - scale.x(bar.start) for bar in row.queued]
    return 2 * sum(width for width in widths if width < _HATCHED) > sum(widths)


def queue_height(row: ResourceRow, *, is_curve: bool) -> float:
    """Return the height of a row's queue."""
    tall = lanes_of(row.queued) * QUEUE_LANE
    if is_curve and lanes_of(row.queued) > 1:
        return min(max(tall, _LOWEST), _HIGHEST)
    return tall


def curve(row: ResourceRow, scale: Scale, column: float, top: float) -> Iterator[str]:
    """Draw the length of a queue as steps, with the greatest number beside its first step.

    A queue of at most one message has no number.
    """
    lengths = queue_lengths(row.queued, scale.start, column)
    steps = [step for step in lengths if step[0] <= scale.end]
    most, tall = max((number for *_, number in steps), default=1), queue_height(row, is_curve=True)
    for start, end, number in steps:
        height = max((tall - 4) * number / most, 1.0)
        title = f"at most {number} {row.queue_kind} {from_to(start, end)}"
        y = top + tall - 2 - height
        yield rectangle(_CURVE, scale.x(start), y, scale.x(end), height, title)
    if lanes_of(row.queued) > 1:
        label = f"up to {most} {row.queue_kind}"
        room = width_of(label)
        start, end = next(
            (map(scale.x, span) for *span, number in steps if number == most), (0.0, 0.0)
        )
        if start > room + _BESIDE:
            yield words("number before", start - _BESIDE, top + 10, label, UNTOUCHED)
        else:
            x = min(end + _BESIDE, scale.width - room)
            yield words("number", x, top + 10, label, UNTOUCHED)
