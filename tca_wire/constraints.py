"""Temporal constraints: one shape, and functions that build the usual ones."""

from enum import IntFlag

import msgspec

from tca_wire.points import ROOT, Moment, Point, TaskId

# Globals, because looking up a member of an IntFlag costs two calls.
_START_ACHIEVING, _END_ACHIEVING = Moment.START_ACHIEVING, Moment.END_ACHIEVING


class Flags(IntFlag):
    """Constraints of a new task relative to its last sibling (*last*) or to itself (*this*).

    They follow the bit mask ``tplConstr`` of TCA 8.5.
    """

    NONE = 0
    SEQ_ACH = 1  # end(achieving last) <= start(achieving this): the default
    SEQ_PLANNING = 2  # end(planning last) <= start(planning this)
    PLAN_FIRST = 4  # end(planning this) <= start(achieving this)
    DELAY_PLANNING = 8  # start(planning this) not before start(achieving this)


class Constraint(
    msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, gc=False
):
    """Point *after* is reached no earlier than *delay* seconds after point *before*.

    If *before* is a point of the root, the delay counts from the time at which central accepts the
    constraint. In the journal such a delay counts from time 0.
    """

    before: Point
    after: Point
    delay: float = 0

    def __str__(self) -> str:
        if self.before.task == ROOT:
            return f"{self.delay:g} s <= {self.after}"
        return f"{self.before}{f' + {self.delay:g} s' if self.delay else ''} <= {self.after}"


def sequential_achievement(first: TaskId, second: TaskId) -> Constraint:
    """Achieve *second* only after *first* has been achieved. Planning may come before."""
    return Constraint(Point(first, _END_ACHIEVING), Point(second, _START_ACHIEVING))


def sequential_planning(first: TaskId, second: TaskId) -> Constraint:
    """Plan *second* only after *first* has been planned."""
    return Constraint(Point(first, Moment.END_PLANNING), Point(second, Moment.START_PLANNING))


def plan_first(task: TaskId) -> Constraint:
    """Plan all of *task* before any of it is achieved."""
    return Constraint(Point(task, Moment.END_PLANNING), Point(task, Moment.START_ACHIEVING))


def delay_planning(task: TaskId) -> Constraint:
    """Plan *task* only once it may be achieved."""
    return Constraint(Point(task, Moment.START_ACHIEVING), Point(task, Moment.START_PLANNING))


def not_before(task: TaskId, seconds: float) -> Constraint:
    """Start *task*, planning included, no earlier than *seconds* from now."""
    return Constraint(
        Point(ROOT, Moment.START_ACHIEVING), Point(task, Moment.START_HANDLING), seconds
    )


def plan_ahead(earlier: TaskId, task: TaskId) -> Constraint:
    """Plan *task* only once *earlier* is being achieved: planning runs no further ahead."""
    return Constraint(Point(earlier, Moment.START_ACHIEVING), Point(task, Moment.START_PLANNING))
