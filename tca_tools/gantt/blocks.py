"""What is too narrow to be drawn one by one, put together: shaded blocks, and the length of a long queue. Pure.

However many bars there are, a lane becomes no more things to draw than it has columns.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import chain, pairwise

from tca_tools.gantt.parts import Bar

_NAMED = 4
"""How many messages the title of a block names."""


@dataclass(slots=True)
class Block:
    """Several bars of a lane that are side by side and too narrow."""

    lane: int
    start: float
    end: float
    bars: list[Bar] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The message that took most of the time."""
        seconds: Counter[str] = Counter()
        for bar in self.bars:
            seconds[bar.name] += bar.end - bar.start  # type: ignore[assignment]  # seconds count too
        return seconds.most_common(1)[0][0]

    @property
    def busy(self) -> float:
        """Which part of its span is filled, from 0 to 1."""
        span = self.end - self.start
        return min(sum(bar.end - bar.start for bar in self.bars) / span, 1.0) if span > 0 else 1.0

    @property
    def is_waiting(self) -> bool:
        """Whether its handlers mostly waited."""
        waits = sum(wait.end - wait.start for bar in self.bars for wait in bar.waits)
        return 2 * waits > sum(bar.end - bar.start for bar in self.bars)

    @property
    def has_failed(self) -> bool:
        """Whether one of its bars failed."""
        return any(bar.has_failed for bar in self.bars)

    @property
    def has_coped(self) -> bool:
        """Whether the run went on after all that failed in it."""
        return all(bar.has_coped for bar in self.bars if bar.has_failed)

    @property
    def was_killed(self) -> bool:
        """Whether one of its bars was killed."""
        return any(bar.was_killed for bar in self.bars)

    @property
    def is_beside(self) -> bool:
        """Whether nothing in it is what was asked for."""
        return all(bar.is_beside for bar in self.bars)

    @property
    def title(self) -> str:
        """All there is to say about it."""
        numbers = Counter(bar.name for bar in self.bars)
        parts = [f"{number} {name}" for name, number in numbers.most_common(_NAMED)]
        parts += [f"{len(numbers) - _NAMED} others"] * (len(numbers) > _NAMED)
        failed, killed = (sum(bar.has_failed for bar in self.bars), sum(bar.was_killed for bar in self.bars))
        ended = "".join(f"; {number} {how}" for number, how in ((failed, "failed"), (killed, "killed")) if number)
        where = f"from {self.start:.3f} s to {self.end:.3f} s, {self.busy:.0%} of the time"
        return f"{len(self.bars)} messages {where}: {', '.join(parts)}{ended}"


def in_blocks(bars: Iterable[Bar], start: float, column: float, narrow: float) -> tuple[list[Bar], list[Block]]:
    """Bars that are longer than *narrow* seconds or alone in their column, and blocks of the others.

    *column* is the length of a column in seconds; the first begins at *start*.
    """
    wide: list[Bar] = []
    blocks: dict[tuple[int, int], Block] = {}
    for bar in bars:
        if column <= 0 or bar.end - bar.start > narrow:
            wide.append(bar)
            continue
        number = int((max(bar.start, start) - start) / column)
        block = blocks.get((bar.lane, number))
        if block is None:
            blocks[bar.lane, number] = block = Block(bar.lane, bar.start, bar.end)
        block.bars.append(bar)
        block.end = max(block.end, bar.end)
    wide += [block.bars[0] for block in blocks.values() if len(block.bars) == 1]
    return wide, [block for block in blocks.values() if len(block.bars) > 1]


def queue_lengths(bars: list[Bar], start: float, column: float) -> list[tuple[float, float, int]]:
    """How many waited at most in each column, where anything did: from, to, number."""
    longest: dict[int, int] = {}
    for begin, end, number in _longest_queue(bars):
        if end < start or column <= 0:
            continue
        first, last = (max(int((time - start) / column), 0) for time in (begin, end))
        for at in range(first, last + 1):
            longest[at] = max(longest.get(at, 0), number)
    return _joined(sorted(longest.items()), lambda at: start + at * column)


def _joined(columns: list[tuple[int, int]], time_of: Callable[[int], float]) -> list[tuple[float, float, int]]:
    """Neighbours of the same length as one."""
    steps: list[list[int]] = []
    for at, number in columns:
        if steps and steps[-1][1] == at and steps[-1][2] == number:
            steps[-1][1] = at + 1
        else:
            steps.append([at, at + 1, number])
    return [(time_of(first), time_of(behind), number) for first, behind, number in steps]


def _longest_queue(bars: Iterable[Bar]) -> list[tuple[float, float, int]]:
    """How many of the bars there are at a time, as steps: from, to, number."""
    changes = sorted(chain(((bar.start, 1) for bar in bars), ((bar.end, -1) for bar in bars)))
    steps: list[tuple[float, float, int]] = []
    number = 0
    for (start, change), (end, _) in pairwise(changes):
        number += change
        if end > start and number:
            steps.append((start, end, number))
    return steps
