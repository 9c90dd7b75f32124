"""Lanes for the lines between siblings, left of their boxes. Pure.

A line connects tasks with the tasks that wait for all of them. It has an arrowhead at each waiting
task. All arrowheads are below all sources, so a reader can tell which task waits for which.
"""

from bisect import bisect, insort
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

MOST_LANES = 5
"""More parallel lines would be hard to follow."""
MOST_LEAVING = 3
"""Lines that one box has room for."""


@dataclass(slots=True)
class Line:
    """Every row of *targets* waits for every row of *sources*; both are ascending row numbers."""

    sources: tuple[int, ...]
    targets: list[int]
    lane: int = 0
    """0 is nearest to the boxes."""

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Each source with each row that waits for it."""
        return list(product(self.sources, self.targets))

    @property
    def ends(self) -> tuple[int, int]:
        """Its top and bottom, in half rows.

        It leaves a box in the lower half, and reaches a box in the upper half.
        """
        return 2 * self.sources[0] + 1, 2 * self.targets[-1]


def lines(pairs: Iterable[tuple[int, int]]) -> list[Line]:
    """Return the lines of siblings, for pairs of a row and a later row that waits for it.

    Lines without room are left out.
    """
    sources: dict[int, list[int]] = {}
    for source, to in sorted(pairs):
        sources.setdefault(to, []).append(source)
    joined: dict[tuple[int, ...], Line] = {}
    for to, rows in sorted(sources.items()):
        joined.setdefault(tuple(rows), Line(tuple(rows), [])).targets.append(to)
    return _assign_lanes(joined.values())


def _assign_lanes(found: Iterable[Line]) -> list[Line]:
    """Assign lanes to the lines. Shorter lines get nearer lanes, so that few lines cross."""
    taken: list[list[tuple[int, int]]] = [[] for _ in range(MOST_LANES)]
    leaving: Counter[int] = Counter()
    placed: list[Line] = []
    for line in sorted(found, key=lambda line: (line.ends[1] - line.ends[0], line.ends)):
        free = [lane for lane in range(MOST_LANES) if _has_room(taken[lane], *line.ends)]
        if not free or any(leaving[source] == MOST_LEAVING for source in line.sources):
            continue
        line.lane = free[0]
        insort(taken[line.lane], line.ends)
        leaving.update(line.sources)
        placed.append(line)
    return placed


def _has_room(taken: list[tuple[int, int]], start: int, end: int) -> bool:
    """Whether no line of a lane overlaps the span from start to end. *taken* is sorted."""
    behind = bisect(taken, (start, end))
    return (behind == len(taken) or taken[behind][0] >= end) and (
        behind == 0 or taken[behind - 1][1] <= start
    )
