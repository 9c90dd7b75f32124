"""Blocks of bars that are too narrow to be drawn one by one, and the length of a queue.

A lane has at most as many blocks as columns, however many bars there are.
"""

from collections import Counter
from collections.abc import Iterable
from functools import partial
from itertools import pairwise

from tca_tools.gantt.chart import Bar, Ending
from tca_tools.spans import levels
from tca_wire.text.measures import from_to, percent

_NAMED = 4
"""The most messages that the title of a block names."""


def in_blocks(
    bars: Iterable[Bar], start: float, column: float, narrow: float
) -> tuple[list[Bar], list[Bar]]:
    """Combine narrow bars into blocks, one for each lane and column.

    Args:
        bars: The bars.
        start: The time at which the first column starts.
        column: The length of a column in seconds.
        narrow: The length in seconds above which a bar is wide.

    Returns:
        The bars that are wide or alone in their column; and the blocks.
    """
    wide: list[Bar] = []
    columns: dict[tuple[int, int], list[Bar]] = {}
    for bar in bars:
        if column <= 0 or bar.end - bar.start > narrow:
            wide.append(bar)
        else:
            columns.setdefault(
                (bar.lane, int((max(bar.start, start) - start) / column)), []
            ).append(bar)
    wide += [group[0] for group in columns.values() if len(group) == 1]
    return wide, [_block(group) for group in columns.values() if len(group) > 1]


def _block(bars: list[Bar]) -> Bar:
    """Combine several bars into one, named after the message that took most of the time."""
    seconds: dict[str, float] = {}
    for bar in bars:
        seconds[bar.name] = seconds.get(bar.name, 0.0) + bar.seconds
    endings = {bar.ending for bar in bars}
    span = bars[0].start, max(bar.end for bar in bars)
    block = Bar(max(seconds, key=seconds.__getitem__), *span, kind=bars[0].kind)
    block.title = partial(_title, block)
    block.is_unselected = all(bar.is_unselected for bar in bars)
    worst = (Ending.FAILED, Ending.HANDLED, Ending.RESOLVED, Ending.KILLED)
    block.ending = next((one for one in worst if one in endings), Ending.NONE)
    block.waits = [wait for bar in bars for wait in bar.waits]
    block.parts = bars
    return block


def share_of(block: Bar) -> float:
    """Return the part of a block's span that its bars fill, from 0 to 1."""
    span = block.end - block.start
    return min(block.seconds / span, 1.0) if span > 0 else 1.0


def _title(block: Bar) -> str:
    numbers = Counter(bar.name for bar in block.parts)
    parts = [f"{number} {name}" for name, number in numbers.most_common(_NAMED)]
    parts += [f"{len(numbers) - _NAMED} others"] * (len(numbers) > _NAMED)
    killed = sum(bar.ending is Ending.KILLED for bar in block.parts)
    failed = sum(bool(bar.ending) for bar in block.parts) - killed
    ended = f"; {failed} failed" * bool(failed) + f"; {killed} killed" * bool(killed)
    where = f"{from_to(block.start, block.end)}, {percent(share_of(block))} of the time"
    return f"{len(block.parts)} messages {where}: {', '.join(parts)}{ended}"


def queue_lengths(
    bars: Iterable[Bar], start: float, column: float
) -> list[tuple[float, float, int]]:
    """Return the longest queue in each column with a queue, as (start, end, number).

    Neighbours of equal length are combined.
    """
    most: dict[int, int] = {}
    for (begin, number), (end, _) in pairwise(levels((bar.start, bar.end) for bar in bars)):
        if number and end >= start and column > 0:
            first, last = (max(int((time - start) / column), 0) for time in (begin, end))
            for place in range(first, last + 1):
                most[place] = max(most.get(place, 0), number)
    steps: list[list[int]] = []
    for place, number in sorted(most.items()):
        if steps and steps[-1][1:] == [place, number]:
            steps[-1][1] = place + 1
        else:
            steps.append([place, place + 1, number])
    return [
        (start + first * column, start + stop * column, number) for first, stop, number in steps
    ]
