"""Whether one point must already come before another: the search that refuses circular constraints.

It looks from both ends at once, one point at a time, and stops when either side is exhausted, so that its cost is
that of the smaller side; points already reached hold nothing back and are left out. Edges are the constraints, the
order within a task, and the parent/child rules: a parent starts before, and ends after, each of its children.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from tca_central.intervals import predecessors_within, successors_within
from tca_central.task_tree import Task, TaskTree
from tca_wire.points import END_ACHIEVING, END_HANDLING, END_PLANNING, START_ACHIEVING, START_HANDLING, START_PLANNING

ENDS_OF_HANDLING = (END_HANDLING, END_PLANNING)
"""What comes after the start of a task's handling where that has been reached before: the first that is not past."""


class Place(NamedTuple):
    """A point of a live task."""

    task: Task
    moment: int


def find_path(tree: TaskTree, start: Place, goal: Place) -> list[Place] | None:
    """The points that lead from *start* to *goal*, both included; None if nothing does."""
    if start == goal:
        return [start]
    ahead = _Side(start, successors)
    behind = _Side(goal, lambda place: predecessors(tree, place))
    while True:
        for side, other in ((ahead, behind), (behind, ahead)):
            found = side.step()
            if found is None:
                return None
            if found in other.came_from:
                return ahead.trail(found)[::-1] + behind.trail(found)[1:]


class _Side:
    """One end of the search: the points met and by which way."""

    def __init__(self, origin: Place, neighbours: Callable[[Place], Iterator[Place]]) -> None:
        self.came_from: dict[Place, Place | None] = {origin: None}
        self._walk = self._points(origin, neighbours)

    def step(self) -> Place | None:
        """One more point; None if there are no more."""
        return next(self._walk, None)

    def _points(self, origin: Place, neighbours: Callable[[Place], Iterator[Place]]) -> Iterator[Place]:
        frontier = [origin]
        for place in frontier:  # grows while it is walked
            for neighbour in neighbours(place):
                if not neighbour.task.reached & neighbour.moment and neighbour not in self.came_from:
                    self.came_from[neighbour] = place
                    frontier.append(neighbour)
                    yield neighbour

    def trail(self, place: Place) -> list[Place]:
        """The way from *place* back to the origin."""
        trail = [place]
        while (previous := self.came_from[trail[-1]]) is not None:
            trail.append(previous)
        return trail


def successors(place: Place) -> Iterator[Place]:
    """The points that wait for a point, those already reached too."""
    task, moment = place
    for following in successors_within(task.is_goal, moment):
        yield Place(task, following)
    if task.delayed and moment == START_ACHIEVING:
        yield Place(task, START_PLANNING)
    for at, follower, its_moment, _ in task.followers or ():
        if at == moment and its_moment == START_HANDLING:
            yield from (Place(follower, one) for one in ENDS_OF_HANDLING)
        elif at == moment:
            yield Place(follower, its_moment)
    yield from _relatives_after(task, moment)


def predecessors(tree: TaskTree, place: Place) -> Iterator[Place]:
    """The points that a point waits for, those already reached too."""
    task, moment = place
    for preceding in predecessors_within(task.is_goal, moment):
        yield Place(task, preceding)
    if task.delayed and moment == START_PLANNING:
        yield Place(task, START_ACHIEVING)
    came_before = START_HANDLING if moment in ENDS_OF_HANDLING else moment
    for at, leader_id, its_moment in task.leaders or ():
        if at in (moment, came_before) and (leader := tree.tasks.get(leader_id)) is not None:
            yield Place(leader, its_moment)
    yield from _relatives_before(task, moment)


def _relatives_after(task: Task, moment: int) -> Iterator[Place]:
    if moment in (START_PLANNING, START_ACHIEVING):
        yield from (Place(child, moment) for child in (task.children or {}).values() if not child.is_free)
    elif moment in (END_PLANNING, END_ACHIEVING) and (parent := task.parent) is not None:
        yield Place(parent, moment)
        if moment == END_ACHIEVING and _decides(task, parent):
            yield from (Place(parent, one) for one in ENDS_OF_HANDLING)
        if moment == END_ACHIEVING and task.rare is not None:
            yield from (Place(asked, one) for asked in task.rare.asked for one in ENDS_OF_HANDLING)


def _relatives_before(task: Task, moment: int) -> Iterator[Place]:
    children = (task.children or {}).values()
    if moment in (START_PLANNING, START_ACHIEVING):
        if task.parent is not None and not task.is_free:
            yield Place(task.parent, moment)
    elif moment in (END_PLANNING, END_ACHIEVING):
        yield from (Place(child, moment) for child in children)
    if moment in ENDS_OF_HANDLING and (task.again or task.rare):
        yield from (Place(child, END_ACHIEVING) for child in children if _decides(child, task))
        yield from (Place(handler, END_ACHIEVING) for handler in (task.rare.asking if task.rare else ()))


def _decides(child: Task, task: Task) -> bool:
    """Whether *task* is not handled before *child* has ended: it waits for it to be retried, or to know if it is. Where
    it was handled before, and reached that point, it is its planning that does not end before.
    """
    return (task.again and not child.is_guest) or (task.rare is not None and task.rare.recovering is child)
