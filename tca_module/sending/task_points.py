"""Points of tasks, and the constraints that comparing them makes.

``first.achieving.end <= second.planning.start`` is a constraint.
"""

from typing import TYPE_CHECKING, NoReturn

from tca_module.checks import POINT, SECONDS, LateText, check
from tca_module.errors import MisuseError
from tca_wire.constraints import Constraint
from tca_wire.points import THIS, Edge, Interval, Point, TaskId, moment_of

_STRICT = "points are compared with <= and >=: write first.achieving.end <= second.achieving.start"


class Order(Constraint, frozen=True):
    """A constraint that was written with ``<=``."""

    def __bool__(self) -> bool:
        # Python reads a <= b <= c as (a <= b) and (b <= c). The value of that would be only the
        # second constraint.
        raise MisuseError(
            f"constraint {self} is neither true nor false: write a <= b <= c as two constraints"
        )


class LaterPoint:
    """A point of a task plus a delay in seconds: the first point of a constraint with a delay."""

    def __init__(self, point: Point, seconds: float) -> None:
        self.point, self.seconds = point, seconds

    def __repr__(self) -> str:
        return f"{self.point} + {self.seconds:g} s"

    def __le__(self, other: Point) -> Order:
        return Order(self.point, _checked(other), self.seconds)


class TaskPoint(Point, frozen=True):
    """A point of a task. Comparing two points with ``<=`` makes a constraint.

    ``point + 2.5`` is 2.5 s after the point. ``>=`` makes a constraint, too; ``<`` and ``>`` raise
    MisuseError.

    Example::

        task.constrain(charge.achieving.end + 0.3 <= flash.achieving.start)
    """

    def __add__(self, seconds: float) -> LaterPoint:
        check(LateText(lambda: f"{self} + seconds"), SECONDS, seconds=seconds)
        return LaterPoint(self, seconds)

    def __le__(self, other: Point) -> Order:
        return Order(self, _checked(other))

    def __lt__(self, other: object) -> NoReturn:
        raise MisuseError(_STRICT)

    __gt__ = __lt__

    def __ge__(self, other: Point | LaterPoint) -> Order:
        return other <= self if isinstance(other, LaterPoint) else Order(_checked(other), self)


def _checked(point: Point) -> Point:
    """Return *point*. Raises MisuseError if it can't be the second point of a constraint."""
    if isinstance(point, LaterPoint):
        raise MisuseError(f"{point} can't come second: write a + seconds <= b")
    check("a constraint", POINT, point=point)
    return point


_EDGES = {
    interval: (moment_of(interval, Edge.START), moment_of(interval, Edge.END))
    for interval in Interval
}


class _HasPoints:
    """A thing with points of a task. Its points are compared, the thing is not."""

    if not TYPE_CHECKING:  # a type checker finds the mistake itself

        def __lt__(self, other: object) -> NoReturn:
            raise MisuseError(f"{type(self).__name__} can't be compared: {_STRICT}")

        __le__ = __gt__ = __ge__ = __lt__


class TaskInterval(_HasPoints):
    """One interval of a task. Its ``start`` and ``end`` are points."""

    def __init__(self, task_id: TaskId, interval: Interval) -> None:
        start, end = _EDGES[interval]
        self.start, self.end = TaskPoint(task_id, start), TaskPoint(task_id, end)


class TaskIntervals(_HasPoints):
    """A thing with the three intervals of a task."""

    def __init__(self, task_id: TaskId) -> None:
        self._task_id = task_id

    @property
    def handling(self) -> TaskInterval:
        """The interval in which the task's handler runs."""
        return self._interval(Interval.HANDLING)

    @property
    def planning(self) -> TaskInterval:
        """The interval in which the task and everything under it are expanded into subtasks."""
        return self._interval(Interval.PLANNING)

    @property
    def achieving(self) -> TaskInterval:
        """The interval in which the task and everything under it are done."""
        return self._interval(Interval.ACHIEVING)

    def _interval(self, interval: Interval) -> TaskInterval:
        return TaskInterval(self._task_id, interval)


this = TaskIntervals(THIS)
"""The new task, in the constraints of the call that sends it.

Example::

    task.goal(REST, constraints=[leg.handling.end <= this.planning.start])
"""
