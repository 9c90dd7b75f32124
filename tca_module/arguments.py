"""What users give to calls, checked before anything leaves: each MisuseError says what, which and what fits."""

from collections.abc import Sequence
from typing import Any

from tca_module.errors import MisuseError
from tca_wire.constraints import Constraint
from tca_wire.declarations import Broadcast, Command, Goal, Inform, Message, MultiQuery, Query, Variable

BRIEF = 1.0
"""Seconds: a wait that is to be shorter ends soon by itself, and is no deadlock."""

HIGHEST_PRIORITY = 1_000_000

_CALLS: dict[type[Message[Any, Any]], str] = {
    Goal: "goal()",
    Command: "command()",
    Query: "query()",
    MultiQuery: "multi_query()",
    Inform: "inform()",
    Broadcast: "broadcast()",
}


def name_of(message: Message[Any, Any]) -> str:
    """A message as errors name it."""
    return f"{message.message_class} '{message.name}'"


# --- messages --------------------------------------------------------------------------------------------------------


def check_message(message: Any) -> None:
    """Raise MisuseError for what is no message: a name, mostly."""
    if not isinstance(message, Message):
        msg = f"{message!r:.60} is no message: give the declaration, such as Goal('walk', Path)"
        raise MisuseError(msg)


def check_class(message: Any, *wanted: type[Message[Any, Any]], call: str = "") -> None:
    """Raise MisuseError for a message of another class than those that *call* takes."""
    if not isinstance(message, wanted):
        known = {**_CALLS, Variable: "set_variable()"}
        advice = f": use {known[type(message)]}" if type(message) in known and not call else ""
        classes = " or ".join(kind.__name__ for kind in wanted)
        msg = f"{call or _CALLS[wanted[0]]} takes messages of class {classes}, and {message!r:.60} is none{advice}"
        raise MisuseError(msg)


def check_executable(message: Any) -> None:
    """Raise MisuseError for what can't be sent whatever its class."""
    if not isinstance(message, tuple(_CALLS)):
        classes = ", ".join(kind.__name__ for kind in _CALLS)
        msg = f"execute() takes messages to send ({classes}), and {message!r:.60} is none"
        raise MisuseError(msg)


# --- options ---------------------------------------------------------------------------------------------------------


def check_priority(message: Message[Any, Any], priority: Any) -> None:
    """Raise MisuseError for a priority that can't be."""
    if not isinstance(priority, int) or abs(priority) > HIGHEST_PRIORITY:
        msg = f"{name_of(message)} can't have priority {priority!r}: whole numbers up to {HIGHEST_PRIORITY} can be"
        raise MisuseError(msg)


def listed(constraints: Any) -> Sequence[Constraint]:
    """The constraints of an option. Raises MisuseError for a single one."""
    if not isinstance(constraints, list | tuple) or not all(isinstance(each, Constraint) for each in constraints):
        msg = f"constraints={constraints!r:.80} is no list of constraints: write constraints=[a <= b, c <= d]"
        raise MisuseError(msg)
    return constraints


def check_timeout(timeout: Any) -> None:
    """Raise MisuseError for what is neither seconds nor None."""
    if timeout is not None and not (isinstance(timeout, int | float) and timeout >= 0):
        msg = f"timeout={timeout!r:.40} is no time to wait: give seconds, 0 or more, or None to wait for ever"
        raise MisuseError(msg)


def blocks(timeout: float | None) -> bool:
    """Whether a wait with this timeout is one for which central looks for deadlocks. Raises as ``check_timeout``."""
    check_timeout(timeout)
    return timeout is None or timeout >= BRIEF
