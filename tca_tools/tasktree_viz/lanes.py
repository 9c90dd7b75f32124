"""Lanes for lines from tasks to those that wait for them, at the left of brothers, so that none can
be misread. Pure.

A line joins all that are waited for by the same tasks: a head at each that waits, none at the
others. All of its heads are below all the others, so whoever follows it sees exactly who waits for
whom.
"""

from bisect import bisect, insort
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

MOST_LANES = 5
"""Beside more lines nobody could follow one with the eye."""
MOST_LEAVING = 3
"""Lines that leave one box, for which it has room."""


@dataclass(slots=True)
class Line:
    """Every one of *to* waits for every one of *sources*: numbers of rows, upwards."""

    sources: tuple[int, ...]
    to: list[int]
    lane: int = 0
    """0: nearest to the boxes."""

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Each that is waited for, with each that waits."""
        return list(product(self.sources, self.to))

    @property
    def ends(self) -> tuple[int, int]:
        """Where it begins and ends, in halves of rows: it leaves a box in the lower half, and comes
        to the upper.
        """
        return 2 * self.sources[0] + 1, 2 * self.to[-1]


def lines(pairs: Iterable[tuple[int, int]]) -> list[Line]:
    """The lines of brothers, for pairs of a row and one below that waits for it. What has no room
    is left out.
    """
    sources: dict[int, list[int]] = {}
    for source, to in sorted(pairs):
        sources.setdefault(to, []).append(source)
    joined: dict[tuple[int, ...], Line] = {}
    for to, some in sorted(sources.items()):
        joined.setdefault(tuple(some), Line(tuple(some), [])).to.append(to)
    return _laid(joined.values())


def _laid(found: Iterable[Line]) -> list[Line]:
    """Short lines stand near the boxes: so others cross them least."""
    taken: list[list[tuple[int, int]]] = [[] for _ in range(MOST_LANES)]
    leaving: Counter[int] = Counter()
    laid: list[Line] = []
    for line in sorted(found, key=lambda line: (line.ends[1] - line.ends[0], line.ends)):
        free = [lane for lane in range(MOST_LANES) if _has_room(taken[lane], *line.ends)]
        if not free or any(leaving[source] == MOST_LEAVING for source in line.sources):
            continue
        line.lane = free[0]
        insort(taken[line.lane], line.ends)
        leaving.update(line.sources)
        laid.append(line)
    return laid


def _has_room(taken: list[tuple[int, int]], start: int, end: int) -> bool:
    """Whether nothing that is in a lane, from top to bottom, is beside what goes from start to
    end.
    """
    behind = bisect(taken, (start, end))
    return (behind == len(taken) or taken[behind][0] >= end) and (
        behind == 0 or taken[behind - 1][1] <= start
    )
