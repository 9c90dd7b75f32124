"""Temporal constraints: one shape, several good names. What they mean for a running tree is
central's business.
"""

from enum import IntFlag

import msgspec

from tca_wire.points import ROOT, Moment, Point, TaskId

_START_ACHIEVING, _END_ACHIEVING = (
    Moment.START_ACHIEVING,
    Moment.END_ACHIEVING,
)  # to look one up costs two calls


class Flags(IntFlag):
    """Constraints of a new task relative to its *last sibling* or to itself (TCA 8.5: the
    ``tplConstr`` bit mask).
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

    Points of the root stand for the time at which central takes the constraint; in the journal, for
    its clock's 0.
    """

    before: Point
    after: Point
    delay: float = 0

    def __str__(self) -> str:
        if self.before.task == ROOT:
            return f"{self.delay:g} s <= {self.after}"
        return f"{self.before}{f' + {self.delay:g} s' if self.delay else ''} <= {self.after}"


def sequential_achievement(first: TaskId, second: TaskId) -> Constraint:
    """*second* is not achieved until *first* has been achieved; it may be planned before."""
    return Constraint(Point(first, _END_ACHIEVING), Point(second, _START_ACHIEVING))


def sequential_planning(first: TaskId, second: TaskId) -> Constraint:
    """*second* is not planned until *first* has been planned."""
    return Constraint(Point(first, Moment.END_PLANNING), Point(second, Moment.START_PLANNING))


def plan_first(task: TaskId) -> Constraint:
    """Nothing of *task* is done before all of it has been planned."""
    return Constraint(Point(task, Moment.END_PLANNING), Point(task, Moment.START_ACHIEVING))


def delay_planning(task: TaskId) -> Constraint:
    """*task* is not planned before it may be achieved."""
    return Constraint(Point(task, Moment.START_ACHIEVING), Point(task, Moment.START_PLANNING))


def not_before(task: TaskId, seconds: float) -> Constraint:
    """*task* is not started, planning included, within *seconds* from now."""
    return Constraint(
        Point(ROOT, Moment.START_ACHIEVING), Point(task, Moment.START_HANDLING), seconds
    )


def plan_ahead(behind: TaskId, task: TaskId) -> Constraint:
    """*task* is not planned until *behind* is being achieved (bounds how far planning runs
    ahead).
    """
    return Constraint(Point(behind, Moment.START_ACHIEVING), Point(task, Moment.START_PLANNING))
