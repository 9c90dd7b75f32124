"""What users give to calls, checked before anything leaves: each MisuseError says what, which and what fits."""

import inspect
from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, TypeGuard

from tca_module.errors import MisuseError
from tca_module.signatures import arguments_taken, is_async
from tca_wire.constraints import Constraint
from tca_wire.messages.controls import ExceptionHandler, Monitor, PollingMonitor
from tca_wire.messages.declarations import (
    Broadcast,
    Command,
    Failure,
    FailureRaised,
    Goal,
    Inform,
    Message,
    MultiQuery,
    Query,
    Variable,
)
from tca_wire.messages.fitting import first_misfit
from tca_wire.messages.formats import NO_DATA
from tca_wire.points import Point
from tca_wire.vocabulary import LONGEST_TIME, Condition, Limit, Scope

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


def name_wanted(message: Any) -> str:
    """The name of the messages that are asked for: of a message, a name, or None, which is all of them ("")."""
    if isinstance(message, Message):
        return message.name
    if message is not None and not isinstance(message, str):
        msg = f"{message!r:.60} is no message: give the declaration, its name, or None for all"
        raise MisuseError(msg)
    if message is None:
        return ""
    if not message:
        msg = f"{message!r} names no message: give the declaration, its name, or None for all"
        raise MisuseError(msg)
    if not _can_be_sent(message):
        msg = f"{message!r:.60} is no text that can be sent"
        raise MisuseError(msg)
    return message


# --- failures --------------------------------------------------------------------------------------------------------


def check_handles(failure: Any, handler: Any) -> None:
    """Raise MisuseError for what can't take care of a failure: it would be found out when the failure is there.

    An exception handler gets the failure's data, which must fit what it wants, or none. One for any failure (None) must
    take None: what central raises, such as "timeout", has no data. What it makes of other data than it wants is its own
    affair.
    """
    if not isinstance(handler, ExceptionHandler):
        msg = f"{handler!r:.60} is no ExceptionHandler: declare the message as one"
        raise MisuseError(msg)
    if failure is None:
        if first_misfit(NO_DATA, handler.data.schema):
            msg = (
                f"{name_of(handler)} wants data of type {handler.data}, and is for any failure, also for those without \
data, as all of central's: declare it without data, or with {handler.data} | None"
            )
            raise MisuseError(msg)
        return
    if not isinstance(failure, Failure):
        msg = f"{failure!r:.60} is no failure: give the declaration, such as Failure('collision', Contact), or None"
        raise MisuseError(msg)
    if handler.data.kind is not type(None) and (misfit := first_misfit(failure.data.schema, handler.data.schema)):
        msg = f"{name_of(handler)} wants data of type {handler.data}, and failure '{failure.name}' has {failure.data}: \
declare both with the same type, or the exception handler without data ({misfit})"
        raise MisuseError(msg)


def checked_pairs(pairs: Any) -> Sequence[tuple[Failure[Any] | None, ExceptionHandler[Any]]]:
    """The value of ``on_failure=``. Raises MisuseError if it is no list of pairs."""
    if not isinstance(pairs, list | tuple) or not all(isinstance(pair, tuple) and len(pair) == 2 for pair in pairs):
        msg = f"on_failure={pairs!r:.80} is no list of pairs: write on_failure=[(COLLISION, RAISE_LEG)]"
        raise MisuseError(msg)
    for failure, handler in pairs:
        check_handles(failure, handler)
    return pairs


def check_attachable(place: Any) -> None:
    """Raise MisuseError for what exception handlers can't be attached to."""
    if not isinstance(place, Message) or not place.message_class.is_task:
        msg = f"of={place!r:.60} never fails: give a goal, a command or a task, or None for all tasks"
        raise MisuseError(msg)


def check_raised(failure: Any) -> None:
    """Raise MisuseError for what can't be raised on a task."""
    if not isinstance(failure, FailureRaised):
        hint = f"call it, {failure.name!r} is only declared" if isinstance(failure, Failure) else "COLLISION(contact)"
        msg = f"fail() takes a failure with its data, and {failure!r:.60} is none: {hint}"
        raise MisuseError(msg)


# --- options ---------------------------------------------------------------------------------------------------------


def is_whole(value: Any) -> TypeGuard[int]:
    """Whether it is a whole number; True and False are none."""
    return isinstance(value, int) and not isinstance(value, bool)


def check_known(what: str, options: Mapping[str, object], known: Collection[str]) -> None:
    """Raise MisuseError for an option that there is not."""
    if unknown := sorted(options.keys() - set(known)):
        msg = f"{what} can't have {unknown[0]}=: the options are {', '.join(known)}"
        raise MisuseError(msg)


def check_flags(what: str, **flags: Any) -> None:
    """Raise MisuseError for what is neither True nor False."""
    for name, flag in flags.items():
        if not isinstance(flag, bool):
            msg = f"{what}: {name}={flag!r:.40} is neither True nor False"
            raise MisuseError(msg)


def check_text(what: str, **texts: Any) -> None:
    """Raise MisuseError for what is no text, or holds half a character, as Python makes them of names of files."""
    for name, text in texts.items():
        if not isinstance(text, str):
            msg = f"{what}: {name}={text!r:.40} is no text"
            raise MisuseError(msg)
        if not _can_be_sent(text):
            msg = f"{what}: {name}={text!r:.40} is no text that can be sent"
            raise MisuseError(msg)


def _can_be_sent(text: str) -> bool:
    return text.isascii() or not any("\ud800" <= character <= "\udfff" for character in text)


def _is_name(name: Any) -> TypeGuard[str]:
    return isinstance(name, str) and bool(name.strip()) and name.isprintable() and len(name) <= Limit.NAME


def checked_name(what: str, name: Any) -> str:
    """*name*, if modules and resources may be called so. Raises MisuseError."""
    if not _is_name(name):
        msg = f"{name!r:.60} is no {what} name: 1 to {Limit.NAME:d} printable characters are"
        raise MisuseError(msg)
    return name


def name_or_none(what: str, **names: Any) -> str:
    """The one name that is given, as central is told of it: None is "". Raises MisuseError for what is no name: an
    empty one, or 0, is some mistake, and does not mean that none is given.
    """
    ((option, name),) = names.items()
    if name is None:
        return ""
    if not _is_name(name):
        msg = f"{what}: {option}={name!r:.60} is no name: give 1 to {Limit.NAME:d} printable characters, or None"
        raise MisuseError(msg)
    return name


def _is_seconds(seconds: Any) -> bool:
    return isinstance(seconds, int | float) and not isinstance(seconds, bool) and seconds >= 0


def check_seconds(what: str, **times: Any) -> None:
    """Raise MisuseError for what is no number of seconds, or more than ten years."""
    for name, seconds in times.items():
        if not _is_seconds(seconds) or seconds > LONGEST_TIME:
            msg = f"{what}: {name}={seconds!r:.40} is no time: give seconds, 0 or more, at most {LONGEST_TIME:g}"
            raise MisuseError(msg)


def check_lasting(what: str, **times: Any) -> None:
    """Raise MisuseError for what is no number of seconds that last: a deadline of 0 s could only be missed."""
    check_seconds(what, **times)
    for name, seconds in times.items():
        if not seconds:
            msg = f"{what}: {name}={seconds!r:.40} is over at once: give seconds, more than 0"
            raise MisuseError(msg)


def check_count(what: str, **counts: Any) -> None:
    """Raise MisuseError for what can't be counted up to."""
    for name, count in counts.items():
        if not is_whole(count) or not 1 <= count < 2**63:
            msg = f"{what}: {name}={count!r:.40} can't be: give 1, 2, ..."
            raise MisuseError(msg)


def checked_maximum(what: str, maximum: Any) -> int:
    """A maximum as central is told of it: None is 0. Raises MisuseError for what is neither None nor a count."""
    if maximum is None:
        return 0
    if not is_whole(maximum) or not 1 <= maximum < 2**63:
        msg = f"{what}: maximum={maximum!r:.40} can't be: give 1, 2, ... or None for any number"
        raise MisuseError(msg)
    return maximum


def check_point(point: Any) -> None:
    """Raise MisuseError for what is no point of a task."""
    if not isinstance(point, Point):
        msg = f"{point!r:.60} is no point of a task: task.achieving.end is one"
        raise MisuseError(msg)


def check_constraints(constraints: Any) -> None:
    """Raise MisuseError for what is no constraint."""
    for constraint in constraints:
        if not isinstance(constraint, Constraint):
            msg = f"{constraint!r:.60} is no constraint: write first.achieving.end <= second.achieving.start"
            raise MisuseError(msg)


def check_number(what: str, number: Any) -> None:
    """Raise MisuseError for what is no number of a task."""
    if not is_whole(number) or not 0 <= number < 2**63:
        msg = f"{what} takes the number of a task, as in the journal, and {number!r:.40} is none"
        raise MisuseError(msg)


def check_condition(condition: Any) -> None:
    """Raise MisuseError for what says not when a wiretap sends its listener."""
    if condition not in tuple(Condition):
        near = get_close_matches(str(condition), tuple(Condition), 1, 0) if isinstance(condition, str) else []
        known = Condition(near[0]) if near else Condition.BEFORE_HANDLING
        msg = f"condition={condition!r:.40} is none: Condition.{known.name} is one"
        raise MisuseError(msg)


def check_topic(topic: Any, known: Collection[str]) -> None:
    """Raise MisuseError for what central has nothing to say of."""
    if topic not in tuple(known):
        msg = f"status() of topic={topic!r:.40} can't be asked: {', '.join(known)} can"
        raise MisuseError(msg)


def check_scope(scope: Any) -> None:
    """Raise MisuseError for what says not what is to be killed."""
    if scope not in tuple(Scope):
        msg = f"scope={scope!r:.40} is none: {', '.join(f'Scope.{one.name}' for one in Scope)} are"
        raise MisuseError(msg)


def check_monitor_options(monitor: Monitor[Any], options: Mapping[str, Any]) -> None:
    """Raise MisuseError for options that the monitor can't have."""
    what = name_of(monitor)
    if not isinstance(monitor, PollingMonitor):
        for name in ("period", "initial_wait"):
            if name in options:
                msg = f"{what} can't have {name}=: only polling monitors test again and again"
                raise MisuseError(msg)
    elif options.get("period") is None:
        msg = f"{what} needs period=: the seconds from one test of its condition to the next"
        raise MisuseError(msg)
    check_lasting(what, **{name: options[name] for name in ("period", "duration") if options.get(name) is not None})
    checked_maximum(what, options.get("maximum"))
    check_count(what, fire_every=options.get("fire_every", 1))
    check_flags(what, **{name: options[name] for name in ("initial_wait", "for_ever", "sequential") if name in options})
    if options.get("until") is not None:
        check_point(options["until"])


def check_function(what: str, function: Any, wanted: str) -> None:
    """Raise MisuseError for what can't be called with arguments such as "(sender, reply)", or must be awaited."""
    number = wanted.count(",") + 1
    if not callable(function):
        msg = f"{what}: {function!r:.60} is no function: give one that takes {wanted}"
        raise MisuseError(msg)
    name = getattr(function, "__qualname__", repr(function))
    if is_async(function):
        msg = f"{what}: {name} is 'async def', and nobody awaits it: make it a plain function"
        raise MisuseError(msg)
    if arguments_taken(function, (number,)) is None:
        msg = f"{what}: {name} is declared with {inspect.signature(function)}: declare it with {wanted}"
        raise MisuseError(msg)


def check_priority(what: str, priority: Any) -> None:
    """Raise MisuseError for a priority that can't be."""
    if not is_whole(priority) or abs(priority) > HIGHEST_PRIORITY:
        msg = f"{what} can't have priority {priority!r}: whole numbers up to {HIGHEST_PRIORITY} can be"
        raise MisuseError(msg)


def listed(constraints: Any) -> Sequence[Constraint]:
    """The constraints of an option. Raises MisuseError for a single one."""
    if not isinstance(constraints, list | tuple) or not all(isinstance(each, Constraint) for each in constraints):
        msg = f"constraints={constraints!r:.80} is no list of constraints: write constraints=[a <= b, c <= d]"
        raise MisuseError(msg)
    return constraints


def check_timeout(timeout: Any) -> None:
    """Raise MisuseError for what is neither seconds nor None."""
    if timeout is not None and not _is_seconds(timeout):
        msg = f"timeout={timeout!r:.40} is no time to wait: give seconds, 0 or more, or None to wait for ever"
        raise MisuseError(msg)


def check_patience(patience: Any) -> None:
    """Raise MisuseError for what is no time to wait for central."""
    if not _is_seconds(patience):
        msg = f"patience={patience!r:.40} is no time to wait for central: give seconds, 0 or more"
        raise MisuseError(msg)


def check_central(central: Any) -> None:
    """Raise MisuseError for what is no place where central could be."""
    if central is None or hasattr(central, "transport"):
        return
    if not isinstance(central, str) or not central:
        msg = f"central={central!r:.60} is no address: give one such as 'tcp://rover:7400', a LocalCentral, or None"
        raise MisuseError(msg)
    check_text("where central is", central=central)


def is_brief(timeout: float | None) -> bool:
    """Whether a wait with this timeout is one that central need not look at. Raises as ``check_timeout``."""
    check_timeout(timeout)
    return timeout is not None and timeout < BRIEF
