"""The options with which goals and commands are sent."""

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict

from tca_module import checks
from tca_wire.constraints import Constraint, Flags
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import Failure


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


KINDS = dict.fromkeys(TaskOptions.__annotations__, checks.FLAG) | {
    "priority": checks.PRIORITY,
    "constraints": checks.CONSTRAINTS,
    "on_failure": checks.PAIRS,
    "deadline": checks.DURATION_OR_NONE,
    "delay": checks.SECONDS,
}
"""What each option must be."""

_FLAGS = {
    "sequential_planning": Flags.SEQ_PLANNING,
    "plan_first": Flags.PLAN_FIRST,
    "delay_planning": Flags.DELAY_PLANNING,
}


def flags_of(options: Mapping[str, object]) -> Flags:
    """The options that are constraints between siblings, as central knows them."""
    flags = Flags.NONE
    for name, flag in _FLAGS.items():
        flags |= flag if options.get(name) else Flags.NONE
    return flags
