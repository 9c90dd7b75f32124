"""Checks of users' arguments, before a message is sent.

A MisuseError names the call, the value and the remedy.
"""

import contextlib
import inspect
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, _GeneratorContextManager
from difflib import get_close_matches
from functools import cache, wraps
from textwrap import dedent, indent
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Any,
    NamedTuple,
    NoReturn,
    ParamSpec,
    TypeVar,
    get_args,
    get_type_hints,
)

from tca_module.errors import MisuseError
from tca_wire.constraints import Constraint
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import (
    Broadcast,
    Command,
    Failure,
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
from tca_wire.vocabulary import LONGEST_TIME, Condition, Limit, Scope, is_name

F = TypeVar("F", bound=Callable[..., Any])
P = ParamSpec("P")
T = TypeVar("T")

BRIEF = 1.0
"""Seconds: central does not count a wait with a shorter timeout as a deadlock."""

HIGHEST_PRIORITY = 1_000_000
MOST_PENDING = 10_000  # central's own limit for one resource
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-6, 1e7  # seconds; the longest is about four months

EXECUTED: dict[type[Message[Any, Any]], str] = {
    Goal: "goal",
    Command: "command",
    Query: "query",
    MultiQuery: "multi_query",
    Inform: "inform",
    Broadcast: "broadcast",
}
"""The classes of messages that can be sent, and the names of the calls that send them."""


class LateText:
    """A text that is made only when it is read. Most such texts are for errors, and never read."""

    __slots__ = ("_make",)

    def __init__(self, make: Callable[[], str]) -> None:
        self._make = make

    def __str__(self) -> str:
        return self._make()


class ArgumentKind(NamedTuple):
    """The kind of value that an argument must be: in words, and as a test."""

    words: str
    fits: Callable[[Any], bool]

    def or_none(self, meaning: str = "") -> "ArgumentKind":
        """Return this kind, extended by None. *meaning* says what None means."""
        return ArgumentKind(
            f"{self.words}, or None{meaning}", lambda value: value is None or self.fits(value)
        )


def quoted(names: Iterable[str], between: str = ", ") -> str:
    """Return names in quotes, for errors."""
    return between.join(f"'{name}'" for name in names) or "none"


def check(call: object, kind: ArgumentKind, **values: Any) -> None:
    """Raise MisuseError for the first of the named values that is of another kind."""
    for name, value in values.items():
        if not kind.fits(value):
            advice = f": give {name}.item()" if hasattr(value, "dtype") else ""
            raise MisuseError(f"{call}: {name} must be {kind.words}, not {value!r:.60}{advice}")


def check_known(lacks: str, name: object, known: Iterable[str]) -> None:
    """Raise MisuseError if *name* is not among the *known* names.

    *lacks* is the start of the error's text, such as "there is no activity".
    """
    if name not in (names := list(known)):
        raise MisuseError(f"{lacks} {name!r:.60}: there are {', '.join(names) or 'none'}")


def check_options(what: str, options: Mapping[str, Any], declared: type) -> None:
    """Raise MisuseError for an unknown option, or for a value of the wrong kind.

    *declared* is the TypedDict that annotates each option with its kind and default.
    """
    kinds = _kinds_of(declared)
    if unknown := sorted(options.keys() - kinds.keys()):
        raise MisuseError(f"{what} has no option {unknown[0]}: the options are {', '.join(kinds)}")
    for name in options:
        check(what, kinds[name], **{name: options[name]})


@cache
def _kinds_of(options: type) -> dict[str, ArgumentKind]:
    return {
        name: hint.__metadata__[0]
        for name, hint in get_type_hints(options, include_extras=True).items()
    }


def number(
    words: str, least: float, most: float = float("inf"), kind: Any = int | float
) -> ArgumentKind:
    """Return the kind of a number from *least* to *most*."""
    return ArgumentKind(
        words,
        lambda value: (
            isinstance(value, kind) and not isinstance(value, bool) and least <= value <= most
        ),
    )


def whole(words: str, least: int, most: float = 2**63 - 1) -> ArgumentKind:
    """Return the kind of a whole number from *least* to *most*."""
    return number(words, least, most, int)


def instance_of(words: str, kind: type | UnionType) -> ArgumentKind:
    """Return the kind of the values of a class."""
    return ArgumentKind(words, lambda value: isinstance(value, kind))


def one_of(words: str, values: Iterable[object]) -> ArgumentKind:
    """Return the kind of the given values."""
    return ArgumentKind(words, lambda value: value in tuple(values))


def list_of(words: str, kind: ArgumentKind, classes: Any = list | tuple) -> ArgumentKind:
    """Return the kind of a list or tuple of values of *kind*."""
    return ArgumentKind(
        words, lambda value: isinstance(value, classes) and all(map(kind.fits, value))
    )


def collection_of(words: str, kind: ArgumentKind) -> ArgumentKind:
    """Return the kind of a list, tuple or set of values of *kind*."""
    return list_of(words, kind, list | tuple | set | frozenset)


def _is_text(text: Any) -> bool:
    """Whether *text* can be sent. A text with surrogates can't; some file names have surrogates."""
    return isinstance(text, str) and (
        text.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in text)
    )


FLAG = instance_of("True or False", bool)
TEXT = ArgumentKind("a text that can be sent", _is_text)
LABEL = ArgumentKind(
    "a text that is not blank", lambda text: isinstance(text, str) and bool(text.strip())
)
FUNCTION = ArgumentKind("a function", callable)
FUNCTION_OR_NONE = FUNCTION.or_none()
NAME = ArgumentKind(
    f"1 to {Limit.NAME:d} printable characters",
    lambda name: isinstance(name, str) and is_name(name),
)
NAME_OR_NONE = NAME.or_none()
SECONDS = number("0 or more seconds, at most ten years", 0, LONGEST_TIME)
SECONDS_OR_NONE = SECONDS.or_none()
DURATION = ArgumentKind(
    "more than 0 seconds, at most ten years", lambda value: SECONDS.fits(value) and value > 0
)
DURATION_OR_NONE = DURATION.or_none()
PERIOD = number(
    f"{SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g} seconds", SHORTEST_PERIOD, LONGEST_PERIOD
)
DELAY = number(f"0 to {LONGEST_PERIOD:g} seconds", 0, LONGEST_PERIOD)
PATIENCE = number("0 or more seconds", 0)
TIMEOUT = PATIENCE.or_none(" to wait for ever")
COUNT = whole("1 or more", 1)
MAXIMUM = COUNT.or_none(" for any number")
HUNG = one_of("'wait' or 'replace'", ("wait", "replace"))
CAPACITY = whole("1 to 256", 1, 256)
PENDING = whole(f"1 to {MOST_PENDING:,}", 1, MOST_PENDING).or_none()
AMOUNT = whole("0 or more", 0)
PLAN_AHEAD = AMOUNT.or_none(" for any number")
PRIORITY = whole(
    f"a whole number from {-HIGHEST_PRIORITY:,} to {HIGHEST_PRIORITY:,}",
    -HIGHEST_PRIORITY,
    HIGHEST_PRIORITY,
)
NUMBER = whole("a number, as in the journal", 0)
POINT = instance_of("a point of a task, such as task.achieving.end", Point)
POINT_OR_NONE = POINT.or_none()
CONSTRAINT = instance_of("a constraint, such as a.achieving.end <= b.planning.start", Constraint)
CONSTRAINTS = list_of("a list of constraints, such as [a <= b, c <= d]", CONSTRAINT)
CONDITION = one_of("a Condition, such as Condition.BEFORE_HANDLING", Condition)
SCOPE = one_of(" or ".join(f"Scope.{one.name}" for one in Scope), Scope)
VARIABLE = instance_of("a Variable", Variable)
MESSAGE = instance_of("a message, such as Goal('walk', Path)", Message)
MESSAGES = ArgumentKind(
    "a list of messages, such as [WALK]",
    lambda value: isinstance(value, Collection) and value != "" and all(map(MESSAGE.fits, value)),
)
MESSAGE_OR_NAME = ArgumentKind(
    "a message, its name, or None for all",
    lambda value: value is None or isinstance(value, Message) or bool(value and _is_text(value)),
)
CAN_FAIL = ArgumentKind(
    "a goal, a command, a task, or None for all tasks",
    lambda value: isinstance(value, Message) and value.message_class.is_task,
)
CENTRAL = ArgumentKind(
    "an address such as 'tcp://rover:7400', a LocalCentral, or None",
    lambda value: value is None or hasattr(value, "transport") or (_is_text(value) and value != ""),
)


def is_brief(call: object, timeout: float | None) -> bool:
    """Check a timeout; return whether the wait is too short to count as a deadlock."""
    if timeout is None or (type(timeout) is float and timeout >= BRIEF):  # the usual cases, fast
        return False
    check(call, TIMEOUT, timeout=timeout)
    return bool(timeout < BRIEF)  # a numpy float compares to a numpy bool


# --- messages -------------------------------------------------------------------------------------


def check_message(message: Any) -> None:
    """Raise MisuseError for a value that is no message, such as a message's name."""
    if not isinstance(message, Message):
        raise MisuseError(
            f"{message!r:.60} is no message: give the declaration, such as Goal('walk', Path)"
        )


def checked_call(method: F) -> F:
    """Return a method that sends one value. MisuseError tells of more values or unknown options."""
    parameters = inspect.signature(method).parameters.values()
    known = [one.name for one in parameters if one.kind is one.KEYWORD_ONLY]
    is_open = any(one.kind is one.VAR_KEYWORD for one in parameters)  # checks its options itself

    @wraps(method)
    def call(sender: Any, message: Any, data: Any = None, *more: Any, **options: Any) -> Any:
        unknown = [] if is_open else [name for name in options if name not in known]
        if more or unknown:
            check_message(message)
            text = f"has data of type {message.data}, but got {1 + len(more)} values: give one"
            if unknown:
                text = f"has no option {unknown[0]}: the options are {', '.join(known) or 'none'}"
            raise MisuseError(f"{message.title} {text}")
        return method(sender, message, data, **options)

    return with_options(call)  # type: ignore[return-value]  # the same, for type checkers


def with_options(function: F) -> F:
    """Name the options of ``**options: Unpack[...]`` in the signature, for ``help`` and editors.

    The TypedDict annotates each option with its kind and default: ``Annotated[int, COUNT, 1]``.
    The default ``...`` stands for one that depends on other things.
    """
    signature = inspect.signature(function)
    *parameters, last = signature.parameters.values()
    options = get_args(last.annotation)  # of Unpack
    if last.kind is last.VAR_KEYWORD and options:
        for name, hint in options[0].__annotations__.items():
            kind, default = hint.__origin__, hint.__metadata__[1]
            parameters.append(
                inspect.Parameter(name, last.KEYWORD_ONLY, default=default, annotation=kind)
            )
        function.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        _describe_options(function, options[0])
    return function


def _describe_options(function: Callable[..., Any], options: type) -> None:
    """Replace "options: see ..." in a docstring by the options, as the TypedDict describes them.

    A TypedDict without Args names the one that has them: "See ``MonitorOptions``".
    """
    text = options.__doc__ or ""
    if named := re.search(r"See ``(\w+)``", text):
        text = function.__globals__[named[1]].__doc__ or ""
    listed = dedent(text.partition("Args:\n")[2].rstrip()) + "\n"
    entries = [
        found[0]
        for found in re.finditer(r"^(\w+): .*\n(?: +.*\n)*", listed, re.MULTILINE)
        if found[1] in options.__annotations__
    ]
    function.__doc__ = re.sub(
        r"^( +)options: .*\n(?:\1 +.*\n)*",
        lambda found: indent("".join(entries), found[1]),
        function.__doc__ or "",
        flags=re.MULTILINE,
    )


def check_class(message: Any, *wanted: type[Message[Any, Any]], call: str = "") -> None:
    """Raise MisuseError for a message of a class that *call* does not accept."""
    if not isinstance(message, wanted):
        has_call = type(message) in EXECUTED and not call
        advice = f": use {EXECUTED[type(message)]}()" if has_call else ""
        if isinstance(message, str):
            advice = f": give the declaration, such as {wanted[0].__name__}({message!r:.60})"
        classes, call = " or ".join(kind.__name__ for kind in wanted), call or EXECUTED[wanted[0]]
        text = f"{call}() takes messages of class {classes}, not {message!r:.60}{advice}"
        raise MisuseError(text)


def check_handles(failure: Any, handler: Any) -> None:
    """Raise MisuseError for an exception handler that can't accept the data of *failure*.

    A handler of any failure (None) must accept None: failures that central raises, such as
    "timeout", have no data.
    """
    if not isinstance(handler, ExceptionHandler):
        text = f"on_failure(): {handler!r:.60} is no ExceptionHandler"
        raise MisuseError(f"{text}: declare the message as one")
    wants = f"{handler.title} wants data of type {handler.data}"
    if failure is None:
        if first_misfit(NO_DATA, handler.data.schema):
            advice = f"declare it without data, or with {handler.data} | None"
            text = "and failures of central, such as 'timeout', have none"
            raise MisuseError(f"{wants}, {text}: {advice}")
    elif not isinstance(failure, Failure):
        advice = "give the declaration, such as Failure('collision'), or None"
        raise MisuseError(f"{failure!r:.60} is no failure: {advice}")
    elif handler.data.kind is not type(None) and (
        misfit := first_misfit(failure.data.schema, handler.data.schema)
    ):
        advice = "declare both with the same type, or the exception handler without data"
        raise MisuseError(
            f"{wants}, and failure '{failure.name}' has {failure.data}: {advice} ({misfit})"
        )


# --- functions ------------------------------------------------------------------------------------


def check_function(
    what: str,
    function: Any,
    wanted: str,
    possible: Sequence[int] = (),
    *,
    may_be_async: bool = False,
) -> int:
    """Return the least number of arguments with which a function can be called.

    With the least number, a parameter with a default keeps its default: ``lambda n=n: ...`` in a
    loop. *possible*: the numbers to try. *wanted*: the arguments for errors, such as "(sender,
    reply)". Raises MisuseError for a value that can't be called with any of these numbers, or that
    must be awaited.
    """
    if not callable(function):
        raise MisuseError(f"{what}: {function!r:.60} is no function: give one that takes {wanted}")
    name = getattr(function, "__qualname__", repr(function))
    if is_async(function) and not may_be_async:
        raise MisuseError(
            f"{what}: {name} is 'async def', which is not awaited here: make it a plain function"
        )
    if inspect.isgeneratorfunction(function) or inspect.isasyncgenfunction(function):
        advice = "make it a plain function, in which task.report() gives intermediate results"
        raise MisuseError(f"{what}: {name} has a 'yield', so a call does not run it: {advice}")
    possible = possible or (wanted.count(",") + 1,)
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return min(possible)  # some functions written in C have no signature
    for number in sorted(possible):
        with contextlib.suppress(TypeError):
            signature.bind(*(None,) * number)
            return number
    raise MisuseError(f"{what}: {name} is declared with {signature}: declare it with {wanted}")


def check_names(kind: type, wanted: Collection[str]) -> None:
    """Warn of methods of a user's class that nearly have a *wanted* name, such as ``canceled``."""
    for name in vars(kind).keys() - wanted:
        if callable(vars(kind)[name]) and (near := get_close_matches(name, wanted, 1, 0.8)):
            text = f"{kind.__name__}.{name}() is nearly '{near[0]}', and is not called"
            warnings.warn(f"{text}: rename it", stacklevel=4)


class OnlyBlocking:
    """The base of objects for ``with``, not ``async with``."""

    if not TYPE_CHECKING:  # a type checker finds the mistake itself

        async def __aenter__(self) -> NoReturn:
            advice = "write 'with'; aconnect() and running_async() are for event loops"
            raise MisuseError(f"'async with' got a {type(self).__name__}, which blocks: {advice}")

        __aexit__ = __aenter__


class _Block(_GeneratorContextManager[Any], OnlyBlocking):
    """The context manager of a call that must be made in a ``with`` statement."""

    def __del__(self) -> None:
        gen = getattr(self, "gen", None)  # None after a call with wrong arguments
        if gen is not None and inspect.getgeneratorstate(gen) == inspect.GEN_CREATED:
            call = f"{self.func.__name__}()"
            warnings.warn(f"{call} alone does nothing: write 'with ...{call}:'", stacklevel=2)


def block(function: Callable[P, Iterator[T]]) -> Callable[P, AbstractContextManager[T]]:
    """Return a generator function as ``contextmanager`` does, with a warning if ``with`` lacks."""
    generator: Any = function
    return wraps(function)(lambda *args, **options: _Block(generator, args, options))


def check_decorator(call: str, given: object) -> None:
    """Raise MisuseError if a function is *given* because a decorator lacks its parentheses.

    *call*: the decorator with its argument, such as "handles(MESSAGE)".
    """
    if inspect.isfunction(given):
        text = f"{given.__qualname__} is decorated without parentheses"
        raise MisuseError(f"{call}: {text}: write @module.{call}")


def is_async(function: Callable[..., object]) -> bool:
    """Whether a function is ``async def``, or an object whose ``__call__`` is ``async def``."""
    called = getattr(function, "__call__", None)  # noqa: B004
    return any(map(inspect.iscoroutinefunction, (function, called)))
