"""Turns the Python error that ends a handler into a failure of its message."""

import asyncio
import traceback
from types import TracebackType

import msgspec

from tca_module.errors import (
    Deadlock,
    LockLost,
    QueryFailed,
    Stopped,
    TaskFailed,
    TaskKilled,
    Timeout,
)
from tca_wire.messages import failures
from tca_wire.messages.declarations import FailureRaised
from tca_wire.packets.headers import Fail
from tca_wire.text.printable import shortened

_TRACEBACK_LIMIT = 8000  # characters

_ADVICE = {
    "exceptions must derive from BaseException": (
        ": to raise a declared failure, call it: raise COLLISION() or raise COLLISION(data)"
    ),
    "can't be used in 'await' expression": (
        ": query() and result() wait themselves: await query_send(), or the sent task itself"
    ),
}
"""Ends of Python's errors, and the remedies for handlers."""


class Misfit(Exception):
    """A handler's data or result do not fit the declaration."""


class Rejection(Exception):
    """A handler rejects its task before it starts, or rejects a client's request."""


class Aborted(TaskKilled):
    """A handler has stopped because a client asked for the task's end."""


class Reissued(Exception):
    """An exception handler passes its failure on."""


# Error of the library -> the name of the failure that it becomes.
_NAMED = (
    (Misfit, failures.BAD_DATA),
    (Deadlock, failures.DEADLOCK),
    (Timeout, failures.TIMEOUT),
    (LockLost, failures.LOCK_LOST),
    (Stopped, failures.MODULE_LOST),
    (asyncio.CancelledError, failures.CANCELLED),
)


def failure_of(delivery: int, error: BaseException) -> tuple[Fail, bytes]:
    """Return the failure for an error that ended a handler, with its data.

    If the error reports that a query or subtask has failed, the handler's failure has the same
    name. It is also a kind of "handler error".
    """
    header, body = _named_failure(delivery, _unwrapped(error))
    return msgspec.structs.replace(header, text=_printable(header.text)), body


def handler_error(delivery: int, error: BaseException) -> tuple[Fail, bytes]:
    """Return the failure "handler error" for an error of any kind."""
    return Fail(delivery, failures.HANDLER_ERROR, _printable(_describe(error))), b""


def module_end_failure(delivery: int, error: BaseException) -> tuple[Fail, bytes]:
    """Return the failure of the message being handled when an error ended the module."""
    what = f"its module was ended by {_summary(error)}"
    return Fail(delivery, failures.MODULE_LOST, _printable(what)), b""


def _summary(error: BaseException | None) -> str:
    return "".join(traceback.format_exception_only(error)).partition("\n")[0]


def crash_text(error: BaseException | None) -> str:
    """Return the error that ends a program, for central; "" for a regular end."""
    if isinstance(error, SystemExit):
        is_crash = bool(error.code)
    else:
        is_crash = isinstance(error, Exception) and not isinstance(error, Stopped)
    return _printable(_summary(error)) if is_crash else ""


def _printable(text: str) -> str:
    """Return a text that can be encoded, and is short enough for central to store it whole.

    Texts of Python may contain surrogates, mostly in file names. Surrogates can't be encoded.
    """
    return shortened(text.encode(errors="backslashreplace").decode())


def _named_failure(delivery: int, error: BaseException) -> tuple[Fail, bytes]:
    if isinstance(error, FailureRaised):
        return Fail(delivery, error.name, error.text, error.kinds), error.body
    if isinstance(error, Rejection):
        return Fail(delivery, failures.REJECTED, str(error)), b""
    if isinstance(error, Reissued):
        return Fail(delivery, "", reissue=True), b""
    if isinstance(error, QueryFailed | TaskFailed):
        return Fail(delivery, error.failure, error.passed_on, [failures.HANDLER_ERROR]), error.body
    for kind, name in _NAMED:
        if isinstance(error, kind):
            text = str(error) or f"{type(error).__name__} in its handler"
            kinds = [] if kind is Misfit else [failures.HANDLER_ERROR]
            return Fail(delivery, name, text, kinds), b""
    return Fail(delivery, failures.HANDLER_ERROR, _describe(error)), b""


def _unwrapped(error: BaseException) -> BaseException:
    """Return the Failure or Deadlock if the group *error* contains nothing else; else *error*.

    asyncio.TaskGroup wraps every error in a group.
    """
    inner = error
    while isinstance(inner, BaseExceptionGroup) and len(inner.exceptions) == 1:
        inner = inner.exceptions[0]
    return inner if isinstance(inner, FailureRaised | Deadlock) else error


def _describe(error: BaseException) -> str:
    """Return the error in one line, then its traceback without the frames of the library."""
    trace = _without_library_frames(error.__traceback__)
    text = "".join(traceback.format_exception(type(error), error, trace)).rstrip()
    if len(text) > _TRACEBACK_LIMIT:
        text = f"{text[: _TRACEBACK_LIMIT // 2]}\n...\n{text[-_TRACEBACK_LIMIT // 2 :]}"
    first = "".join(traceback.format_exception_only(error)).rstrip()
    advice = (remedy for words, remedy in _ADVICE.items() if str(error).endswith(words))
    return f"{first}{next(advice, '')}\n{text}"


def _without_library_frames(trace: TracebackType | None) -> TracebackType | None:
    """Return the traceback without its first frames, in which the library calls the handler."""
    while trace is not None and trace.tb_next is not None:
        package = trace.tb_frame.f_globals.get("__package__") or ""
        if package.partition(".")[0] != __package__.partition(".")[0]:
            break
        trace = trace.tb_next
    return trace
