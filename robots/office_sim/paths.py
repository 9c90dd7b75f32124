"""The shortest way around walls and tables, along their corners. Pure."""

import heapq
import itertools

from robots.office_sim.vocabulary import Approach, Block, FloorPlan, Spot

RADIUS = 0.3
"""The radius (m) of the robot."""

CLEARANCE = 0.02
"""The distance (m) at which the robot passes corners."""


class NoPath(Exception):
    """There is no way to the place."""


def path_to(floor: FloorPlan, start: Spot, wanted: Approach) -> list[Spot]:
    """Return the points to drive to, in order; empty if the robot is near enough. Raises NoPath."""
    blocks = [block.grown(RADIUS) for block in (*floor.walls, *floor.tables)]
    corners = [
        Spot(x, y)
        for block in (block.grown(CLEARANCE) for block in blocks)
        for x, y in itertools.product((block.left, block.right), (block.bottom, block.top))
    ]
    spots = [start, *(spot for spot in corners if floor.is_free(spot, RADIUS)), wanted.spot]
    return _cut([start, *_shortest(spots, blocks)], wanted.within)


def is_clear(start: Spot, end: Spot, block: Block) -> bool:
    """Return whether no part of a straight way lies inside a block."""
    first, last = 0.0, 1.0
    for begin, goal, low, high in (
        (start.x, end.x, block.left, block.right),
        (start.y, end.y, block.bottom, block.top),
    ):
        if begin == goal:
            if not low < begin < high:
                return True
            continue
        enters, leaves = sorted(((low - begin) / (goal - begin), (high - begin) / (goal - begin)))
        first, last = max(first, enters), min(last, leaves)
    return first >= last


def _shortest(spots: list[Spot], blocks: list[Block]) -> list[Spot]:
    """Return the way from the first spot to the last, by Dijkstra's algorithm; without the first
    spot.
    """
    start, goal = spots[0], spots[-1]
    before: dict[Spot, Spot] = {}
    known, queue = {start: 0.0}, [(0.0, 0, start)]
    order = itertools.count(1)
    while queue:
        distance, _, here = heapq.heappop(queue)
        if here == goal:
            way = [goal]
            while way[-1] in before:
                way.append(before[way[-1]])
            return way[-2::-1]
        for there in spots:
            length = distance + here.to(there)
            if length < known.get(there, float("inf")) and all(
                is_clear(here, there, block) for block in blocks
            ):
                known[there], before[there] = length, here
                heapq.heappush(queue, (length, next(order), there))
    raise NoPath(f"nothing leads to ({goal.x:.2f}, {goal.y:.2f})")


def _cut(way: list[Spot], within: float) -> list[Spot]:
    """Return the points of a way after its first, up to the place that is *within* metres of the
    goal.
    """
    *middle, goal = way
    far = list(itertools.takewhile(lambda spot: spot.to(goal) > within, middle))
    if len(far) < len(middle):
        return way[1 : len(far) + 1]
    return [*middle[1:], goal.towards(middle[-1], within) if within else goal]
