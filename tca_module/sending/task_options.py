"""The options with which goals and commands are sent."""

from collections.abc import Sequence
from typing import Any, TypedDict

from tca_module import checks
from tca_module.checks import check, check_known, name_of
from tca_wire.constraints import Constraint, Flags
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import Failure, Message


class TaskOptions(TypedDict, total=False):
    """How a new task relates to its siblings."""

    sequential: bool
    """It is achieved after the sibling before it (SEQ_ACH); True unless said otherwise."""
    sequential_planning: bool
    """It is planned after the sibling before it has been planned (SEQ_PLANNING)."""
    plan_first: bool
    """All of it is planned before any of it is done (PLAN_FIRST)."""
    delay_planning: bool
    """It is planned only when it may be achieved (DELAY_PLANNING)."""
    priority: int
    """Higher goes first where several wait for one resource."""
    constraints: Sequence[Constraint]
    """Others; ``this`` stands for the new task."""
    on_failure: Sequence[tuple[Failure[Any] | None, ExceptionHandler[Any]]]
    """Exception handlers of the new task, each newer than the one before it; None is any failure."""
    deadline: float | None
    """Seconds, above 0, within which it must be achieved, or the failure "timeout" is raised on it; None: no bound."""
    delay: float
    """Seconds, from now, within which it is not started; 0: at once."""
    keep: bool
    """Its data, outcome and place can be asked for after its end, as after ``keep()`` of its handle."""


def check_options(message: Message[Any, Any], options: TaskOptions) -> None:
    """Raise MisuseError for options that the message can't have."""
    what = name_of(message)
    check_known(what, options, TaskOptions.__annotations__)
    given: dict[str, Any] = {**options}
    check(what, checks.FLAG, **{name: given[name] for name in _FLAGS if name in given})
    check(what, checks.PRIORITY, priority=options.get("priority", 0))
    check(what, checks.SECONDS, delay=options.get("delay", 0))
    check(what, checks.DURATION_OR_NONE, deadline=options.get("deadline"))
    check(what, checks.CONSTRAINTS, constraints=options.get("constraints", ()))


_FLAGS = ("sequential", "sequential_planning", "plan_first", "delay_planning", "keep")


def flags_of(options: TaskOptions) -> Flags:
    """The options that are constraints between siblings, as central knows them."""
    flags = Flags.NONE
    if options.get("sequential_planning"):
        flags |= Flags.SEQ_PLANNING
    if options.get("plan_first"):
        flags |= Flags.PLAN_FIRST
    if options.get("delay_planning"):
        flags |= Flags.DELAY_PLANNING
    return flags
