"""Draws what waits below a row's bars: hatched bars, or where those would be too many or too
narrow, how many wait.
"""

from collections.abc import Iterator

from tca_tools.drawing.svg import UNTOUCHED, rectangle, width_of, words
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.blocks import queue_lengths
from tca_tools.gantt.chart import ResourceRow, lanes_of
from tca_wire.text.measures import from_to

QUEUE_LANE = 9.0
MOST_QUEUE_LANES, _MOST_OF_NOBODYS = 6, 3
"""Of a longer queue only the length is drawn; what is no module's takes less room."""
_HIGHEST, _LOWEST = 30.0, 16.0
"""Pixels: of the row of a length; there must be room for its number."""
_HATCHED = 14.0
"""Pixels: of a bar whose hatching can be seen."""
_BESIDE = 6.0
_CURVE = 'class="curve"'


def is_curve(row: ResourceRow, scale: Scale) -> bool:
    """Whether only the length of its queue is drawn: of a long one, and of one that is mostly in
    bars too narrow.
    """
    if lanes_of(row.queued) > (_MOST_OF_NOBODYS if row.is_nobodys else MOST_QUEUE_LANES):
        return True
    widths = [scale.x(bar.end) - scale.x(bar.start) for bar in row.queued]
    return 2 * sum(width for width in widths if width < _HATCHED) > sum(widths)


def queue_height(row: ResourceRow, *, is_curve: bool) -> float:
    """How much room its queue takes."""
    tall = lanes_of(row.queued) * QUEUE_LANE
    if is_curve and lanes_of(row.queued) > 1:
        return min(max(tall, _LOWEST), _HIGHEST)
    return tall


def curve(row: ResourceRow, scale: Scale, column: float, top: float) -> Iterator[str]:
    """How many wait, as a line of steps; beside the first of the highest, left or right of it, the
    number, if ever more than one does.
    """
    lengths = queue_lengths(row.queued, scale.start, column)
    steps = [one for one in lengths if one[0] <= scale.end]
    most, tall = max((number for *_, number in steps), default=1), queue_height(row, is_curve=True)
    for start, end, number in steps:
        height = max((tall - 4) * number / most, 1.0)
        title = f"at most {number} {row.queue_kind} {from_to(start, end)}"
        y = top + tall - 2 - height
        yield rectangle(_CURVE, scale.x(start), y, scale.x(end), height, title)
    if lanes_of(row.queued) > 1:
        said = f"up to {most} {row.queue_kind}"
        room = width_of(said)
        start, end = next(
            (map(scale.x, span) for *span, number in steps if number == most), (0.0, 0.0)
        )
        if start > room + _BESIDE:
            yield words("number before", start - _BESIDE, top + 10, said, UNTOUCHED)
        else:
            x = min(end + _BESIDE, scale.width - room)
            yield words("number", x, top + 10, said, UNTOUCHED)
